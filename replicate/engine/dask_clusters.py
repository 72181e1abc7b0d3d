"""Starts the Dask cluster that CLUSTER names, or finds the one that runs already."""

import logging
import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass

import dask
import distributed

from replicate.engine.cluster_config import Cluster, LocalCluster, RunningCluster, SlurmCluster
from replicate.engine.device import visible_gpus
from replicate.engine.exceptions import InputError, RunError
from replicate.engine.paths import ROOT

REACHED_WITHIN_S = 8.0
STARTS = 2  # of local workers, if one of them ends before it is ready
_HERE = "127.0.0.1"  # a scheduler or a worker runs whatever code reaches one of its ports
_PORTS = {"port": 0, "dashboard": False, "dashboard_address": f"{_HERE}:0"}  # any that are free


@dataclass
class Connection:
    """A Dask client, the cluster if it was started here, and what its workers offer.

    cores: the most threads that one worker gives to a stage. gpus: whether some worker has a GPU. watch: looks after
    the cluster; to be called now and then.
    """

    client: distributed.Client
    cluster: distributed.deploy.Cluster | None
    cores: int
    gpus: bool
    watch: Callable[[], None] = lambda: None


def connect(settings: Cluster) -> Connection:
    """Return a connection to the cluster, started if need be.

    Raises InputError if a scheduler can't be reached, or Slurm refuses such jobs; RunError if a running scheduler has
    no workers that stages can be given to.
    """
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what matters of it is said in our words
    if isinstance(settings, LocalCluster):
        gpus = visible_gpus()
        cluster = _local(settings.workers, gpus)
        return Connection(distributed.Client(cluster), cluster, 1, bool(gpus))
    if isinstance(settings, SlurmCluster):
        from replicate.engine.slurm_jobs import SlurmWatch, start_jobs

        cluster = start_jobs(settings)
        return Connection(
            distributed.Client(cluster),
            cluster,
            settings.cores,
            settings.gpus > 0,
            SlurmWatch(cluster, settings.jobs).look,
        )
    return _running(settings)


def _local(count: int, gpus: list[str]) -> distributed.SpecCluster:
    """Return workers on this machine; one that ends while it starts ends the others, and all are started once more."""
    folder = os.path.join(tempfile.gettempdir(), f"replicate-dask-{os.getuid()}")
    for attempt in range(1, STARTS + 1):
        try:
            return distributed.SpecCluster(
                workers=local_workers(count, gpus, folder),
                scheduler={"cls": distributed.Scheduler, "options": {"host": _HERE, **_PORTS}},
                silence_logs=logging.CRITICAL,
            )
        except RuntimeError as error:  # "Nanny failed to start."
            why = error.__cause__ or error
            if attempt == STARTS:
                what = f"a Dask worker ends while it starts ({type(why).__name__}: {why})"
                raise RunError(f"CLUSTER is local:{count}: {what}; JOBS without CLUSTER needs none") from None


def local_workers(count: int, gpus: list[str], folder: str) -> dict[int, dict]:
    """Return Dask's description of workers on this machine: the first ones have a GPU each, the others none."""
    descriptions = {}
    for place in range(count):
        own_gpu = gpus[place : place + 1]
        options = {
            "host": _HERE,  # of the worker, of its page, and of the nanny that looks after it
            "nthreads": 1,
            "memory_limit": 0,  # it would count the memory of the Dask worker, not that of its stage
            "local_directory": folder,
            "dashboard": False,
            "resources": {"CPU": 1, **({"GPU": 1} if own_gpu else {})},
            "env": {"CUDA_VISIBLE_DEVICES": "".join(own_gpu)},
            "silence_logs": logging.CRITICAL,
        }
        descriptions[place] = {"cls": distributed.Nanny, "options": options}
    return descriptions


def _running(settings: RunningCluster) -> Connection:
    address = settings.address
    try:
        with dask.config.set({"distributed.comm.timeouts.connect": REACHED_WITHIN_S}):
            client = distributed.Client(address, timeout=REACHED_WITHIN_S, set_as_default=False)
    except (OSError, TimeoutError) as error:
        raise InputError(f"CLUSTER is {address}: found no Dask scheduler there ({type(error).__name__})") from None
    workers = client.scheduler_info(n_workers=-1)["workers"].values()
    offers = [worker["resources"] for worker in workers]
    cores = [int(offer["CPU"]) for offer in offers if offer.get("CPU", 0) >= 1]
    if not cores:
        client.close()
        what = f"none of its {len(offers)} workers offers CPUs" if offers else "it has no workers"
        start = f"python -m distributed.cli.dask_worker {address} --nthreads 1 --resources CPU=1"
        raise RunError(f"CLUSTER is {address}: {what}: start some in {ROOT} with `{start}`")
    return Connection(client, None, max(cores), any("GPU" in offer for offer in offers))
