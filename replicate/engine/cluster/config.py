"""What CLUSTER names: worker processes on this machine, a running Dask scheduler, or jobs of Slurm."""

import importlib.util
import re
import shutil
from dataclasses import dataclass
from pathlib import Path

from replicate.base.exceptions import InputError
from replicate.base.schema import Checked, naming, number, read_table
from replicate.base.user_files import read_toml

_MOST_WORKERS = 1024
_FORMS = "local:4 (workers on this machine), tcp://host:8786 (a Dask scheduler) or the path of a .toml file (Slurm)"
_PACKAGES = ("distributed", "dask_jobqueue")  # the extra `cluster`
_INSTALL = "python -m pip install distributed dask-jobqueue"


@dataclass(frozen=True)
class LocalCluster:
    """`local:4`: Dask workers on this machine, of one thread each; each GPU goes to one of them."""

    workers: int


@dataclass(frozen=True)
class RunningCluster:
    """`tcp://host:8786`: a Dask scheduler that was started by hand, as were its workers."""

    address: str


@dataclass(frozen=True)
class SlurmCluster(Checked):
    """`slurm.toml`: equal jobs of Slurm, each with one Dask worker that runs as many stages as the job has cores.

    jobs: how many are submitted, and submitted again when Slurm has ended them.
    cores, memory, gpus: of each job; at most one GPU, since stages that share one would also share its memory.
    walltime: such as `04:00:00`.
    partition, account: Slurm's default if empty.
    interface: the network interface over which jobs reach this machine; if empty, the one that leads outside.
    directives: further options of sbatch, such as `--constraint=avx512 --exclusive`.
    prologue: shell commands that a job begins with, such as `module load cuda`.
    """

    jobs: int = number(1, 1, _MOST_WORKERS)
    cores: int = number(1, 1, _MOST_WORKERS)
    memory: str = "4GB"
    walltime: str = "04:00:00"
    gpus: int = number(0, 0, 1)
    partition: str = ""
    account: str = ""
    interface: str = ""
    directives: str = ""
    prologue: str = ""


Cluster = LocalCluster | RunningCluster | SlurmCluster


def read_cluster(text: str) -> Cluster:
    """Return what CLUSTER names.

    Raises InputError for any other text, for a file with mistakes, and if a package or program is missing.
    """
    cluster = _parse(text.strip())
    missing = [package.replace("_", "-") for package in _PACKAGES if importlib.util.find_spec(package) is None]
    if missing:
        raise InputError(f"CLUSTER={text} needs the package {missing[0]}, of the extra `cluster`: {_INSTALL}")
    if isinstance(cluster, SlurmCluster) and shutil.which("sbatch") is None:
        raise InputError(f"CLUSTER={text} needs Slurm, and there is no sbatch here: run on a machine that submits jobs")
    return cluster


def is_elsewhere(text: str | None) -> bool:
    """Return whether CLUSTER names other machines, which may have other GPUs."""
    return bool(text) and not isinstance(_parse(text.strip()), LocalCluster)


def _parse(text: str) -> Cluster:
    if match := re.fullmatch(r"local:(\d{1,4})", text, re.ASCII):
        if not 1 <= int(match[1]) <= _MOST_WORKERS:
            raise InputError(f"CLUSTER: expected 1 to {_MOST_WORKERS} workers, got {text!r}")
        return LocalCluster(int(match[1]))
    if re.fullmatch(r"tcp://[^\s/:]+:\d{1,5}|tcp://\[[0-9a-fA-F:.]+\]:\d{1,5}", text, re.ASCII):
        return RunningCluster(text)
    if text.endswith(".toml"):
        return _read_slurm(Path(text))
    raise InputError(f"CLUSTER: expected {_FORMS}, got {text[:100]!r}")


def _read_slurm(file: Path) -> SlurmCluster:
    with naming(str(file)):
        cluster = read_table(SlurmCluster, read_toml(file))
    forms = {
        "memory": (r"\d{1,6}(\.\d+)? ?[MGT]i?B", "a size such as 8GB"),
        "walltime": (r"(\d+-)?\d{1,3}(:\d\d){1,2}", "a time such as 04:00:00 or 2-00:00:00"),
        "partition": (r"[\w,.-]*", "a name"),
        "account": (r"[\w.-]*", "a name"),
        "interface": (r"[\w.-]*", "a name such as eth0"),
        "directives": (r"[^\n]*", "options in one line"),
    }
    for key, (form, words) in forms.items():
        if not re.fullmatch(form, getattr(cluster, key)):
            raise InputError(f"{file}: {key}: expected {words}, got {getattr(cluster, key)!r}")
    return cluster
