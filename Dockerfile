# What replicate.sh does, in a container: `docker build --tag replicate .`, `docker run --rm replicate`. Not tried where it
# was written, for want of Docker; replicate.sh was, on a bare Debian 12. On Linux the torch that comes by default brings
# gigabytes of CUDA: `--build-arg PIP_EXTRA_INDEX_URL=<the index of torch's builds for CPUs>` has the small one.
FROM debian:12-slim
RUN apt-get update -qq \
    && DEBIAN_FRONTEND=noninteractive apt-get install -qq --yes --no-install-recommends \
        ca-certificates libegl1 libgl1-mesa-dri make python3 python3-venv \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /suite
COPY . .
ARG PIP_EXTRA_INDEX_URL
RUN make environment
CMD ["./replicate.sh"]
