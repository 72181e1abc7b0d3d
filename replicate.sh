#!/bin/sh
# From a bare Debian 12 or Ubuntu 24.04 to Table 2 of the teen with the profile `quick`: the system's packages, then
# Python's, then `make table2 PROFILE=quick`. Takes no parameters; started again, it goes on where it was.
# shellcheck disable=SC2086 # $wanted is a list of words
set -eu
cd "$(dirname "$0")"

wanted=
python3 -c 'import ensurepip, sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || wanted="python3 python3-venv"
command -v make >/dev/null || wanted="$wanted make"
for package in libegl1 libgl1-mesa-dri; do # VTK draws off screen by EGL and Mesa's software driver
    dpkg-query --show --showformat '${db:Status-Status}' "$package" 2>/dev/null | grep -qx installed ||
        wanted="$wanted $package"
done

if [ "$wanted" ]; then
    root=
    [ "$(id -u)" -eq 0 ] || root=sudo
    if ! command -v apt-get >/dev/null || ! command -v ${root:-env} >/dev/null; then
        echo "replicate.sh: expected apt-get and root's rights to install them, or these packages:" $wanted >&2
        exit 2
    fi
    $root apt-get update -qq
    $root env DEBIAN_FRONTEND=noninteractive apt-get install -qq --yes --no-install-recommends $wanted
fi
exec make table2 PROFILE=quick
