"""Starts the Dask cluster that CLUSTER names, or connects to one that is running."""

import logging
import os
import shlex
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import dask
import distributed

from replicate.base.exceptions import InputError, RunError
from replicate.base.paths import ROOT, cache_folder
from replicate.engine.cluster.config import Cluster, LocalCluster, RunningCluster, SlurmCluster
from replicate.engine.device import visible_gpus

if TYPE_CHECKING:
    import dask_jobqueue

REACHED_WITHIN_S = 8.0
STARTS = 2  # of local workers, if one of them ends before it is ready
_HERE = "127.0.0.1"  # only: a scheduler or a worker runs any code that reaches its ports
_PORTS = {"port": 0, "dashboard": False, "dashboard_address": f"{_HERE}:0"}  # any that are free


@dataclass
class Connection:
    """A Dask client and its cluster.

    cluster: None if it was not started here.
    cores: the most threads that one worker gives to a stage.
    gpus: whether some worker has a GPU.
    watch: looks after the cluster; to be called now and then.
    """

    client: distributed.Client
    cluster: distributed.deploy.Cluster | None
    cores: int
    gpus: bool
    watch: Callable[[], None] = lambda: None


def connect(settings: Cluster) -> Connection:
    """Return a connection to the cluster, which is started if need be.

    Raises InputError if the scheduler can't be reached or Slurm refuses the jobs, RunError if a running scheduler has
    no workers that offer CPUs.
    """
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # its errors are reported in our words
    if isinstance(settings, LocalCluster):
        gpus = visible_gpus()
        cluster = _local(settings.workers, gpus)
        return Connection(distributed.Client(cluster), cluster, 1, bool(gpus))
    if isinstance(settings, SlurmCluster):
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
    """Return workers on this machine; if one of them ends while it starts, all are started once more."""
    folder = os.path.join(tempfile.gettempdir(), f"replicate-dask-{os.getuid()}")
    for attempt in range(1, STARTS + 1):
        try:
            return distributed.SpecCluster(
                workers=local_workers(count, gpus, folder),
                scheduler={"cls": distributed.Scheduler, "options": {"host": _HERE, **_PORTS}},
                silence_logs=logging.CRITICAL,
            )
        except RuntimeError as error:  # "Nanny failed to start."
            cause = error.__cause__ or error
            if attempt == STARTS:
                why = f"a Dask worker ends while it starts ({type(cause).__name__}: {cause})"
                raise RunError(f"CLUSTER is local:{count}: {why}; use JOBS={count} without CLUSTER") from None


def local_workers(count: int, gpus: list[str], folder: str) -> dict[int, dict]:
    """Return Dask's description of workers on this machine: the first ones get a GPU each, the others none."""
    descriptions = {}
    for place in range(count):
        gpu = gpus[place : place + 1]
        options = {
            "host": _HERE,  # of the worker, of its page, and of the nanny that looks after it
            "nthreads": 1,
            "memory_limit": 0,  # no limit: Dask would count its worker's memory, not the stage's
            "local_directory": folder,
            "dashboard": False,
            "resources": {"CPU": 1, **({"GPU": 1} if gpu else {})},
            "env": {"CUDA_VISIBLE_DEVICES": "".join(gpu)},
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
        why = f"none of its {len(offers)} workers offers CPUs" if offers else "it has no workers"
        start = f"python -m distributed.cli.dask_worker {address} --nthreads 1 --resources CPU=1"
        raise RunError(f"CLUSTER is {address}: {why}: start some in {ROOT} with `{start}`")
    return Connection(client, None, max(cores), any("GPU" in offer for offer in offers))


# Dask workers as jobs of Slurm, which are submitted again when they have ended.

_LOOK_EVERY_S = 10.0
_ANNOUNCED_AFTER_S = 5.0
_LOST_AFTER_S = 60.0  # without a worker, and without a job that could become one


def start_jobs(settings: SlurmCluster) -> "dask_jobqueue.SLURMCluster":
    """Return a cluster whose jobs are submitted; raise InputError with Slurm's words if it refuses them."""
    import dask_jobqueue  # only here: it makes Ctrl-C end a process silently

    logging.getLogger("dask_jobqueue").setLevel(logging.CRITICAL)
    try:
        cluster = dask_jobqueue.SLURMCluster(**slurm_options(settings))
    except (RuntimeError, ValueError) as error:  # as for an interface that this machine does not have
        raise InputError(f"CLUSTER: {error}") from None
    trial = ["sbatch", "--test-only"]
    answer = subprocess.run(trial, input=cluster.job_script(), capture_output=True, text=True, check=False)
    if answer.returncode:
        cluster.close()
        words = " ".join(line.removeprefix("sbatch: error: ") for line in answer.stderr.splitlines()[-1:])
        raise InputError(f"CLUSTER: Slurm refuses the jobs ({words})")
    cluster.scale(jobs=settings.jobs)
    return cluster


def slurm_options(settings: SlurmCluster) -> dict:
    """Return the arguments of `dask_jobqueue.SLURMCluster`."""
    resources = f"CPU={settings.cores}" + (",GPU=1" if settings.gpus else "")
    gpu = ["--gres=gpu:1"] if settings.gpus else []
    return {
        "cores": settings.cores,
        "processes": 1,
        "memory": settings.memory,
        "walltime": settings.walltime,
        "queue": settings.partition or None,
        "account": settings.account or None,
        "interface": settings.interface or None,
        "job_name": "replicate",
        "job_extra_directives": [*gpu, *shlex.split(settings.directives)],
        "job_script_prologue": [f"export PYTHONPATH={shlex.quote(str(ROOT))}", *settings.prologue.splitlines()],
        "worker_extra_args": ["--resources", resources, "--no-dashboard"],
        "death_timeout": 20,  # seconds without a scheduler after which a worker ends its job
        "log_directory": str(log_folder()),
        "scheduler_options": {"dashboard": False, "dashboard_address": "127.0.0.1:0"},
        "silence_logs": logging.CRITICAL,
    }


def log_folder() -> Path:
    """Return the folder for the jobs' output; that of stages is in their logs."""
    return cache_folder() / "slurm"


class SlurmWatch:
    """Tells when a run waits for Slurm, submits ended jobs again, and notices when none is left."""

    def __init__(self, cluster: "dask_jobqueue.SLURMCluster", jobs: int):
        self._cluster, self._jobs = cluster, jobs
        self._started = self._looked = self._well = time.monotonic()
        self._announced = False

    def look(self) -> None:
        """Look at the jobs if it is time to; raise RunError if there has been none for a minute."""
        now = time.monotonic()
        has_workers = bool(self._cluster.scheduler_info["workers"])
        if not self._announced and not has_workers and now - self._started >= _ANNOUNCED_AFTER_S:
            self._announced = True
            print(f"waiting for Slurm to start one of {self._jobs} jobs", file=sys.stderr, flush=True)
        if now - self._looked < _LOOK_EVERY_S:
            return
        self._looked = now
        self._cluster.scale(jobs=self._jobs)  # what Dask has noticed as lost is submitted again
        if has_workers or self._has_jobs():
            self._well = now
        elif now - self._well >= _LOST_AFTER_S:
            raise RunError(f"Slurm has ended all jobs: their logs are in {log_folder()}")

    def _has_jobs(self) -> bool:
        """Return whether a job of this cluster waits or runs; true if Slurm doesn't answer."""
        job_ids = {str(job.job_id) for job in self._cluster.workers.values()}
        command = ["squeue", "--me", "--noheader", "--format=%i"]
        try:
            answer = subprocess.run(command, capture_output=True, text=True, check=True, timeout=30)
        except (OSError, subprocess.SubprocessError):
            return True
        return not job_ids.isdisjoint(answer.stdout.split())
