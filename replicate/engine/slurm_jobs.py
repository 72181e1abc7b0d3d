"""Dask workers as jobs of Slurm: submitted as the file says, looked after, and submitted again when they have ended."""

import logging
import shlex
import subprocess
import sys
import time
from pathlib import Path

import dask_jobqueue

from replicate.engine.cluster_config import SlurmCluster
from replicate.engine.exceptions import InputError, RunError
from replicate.engine.paths import ROOT, cache_folder

_LOOK_EVERY_S = 10.0
_ANNOUNCED_AFTER_S = 5.0
_LOST_AFTER_S = 60.0  # without a worker, and without a job that could become one


def start_jobs(settings: SlurmCluster) -> dask_jobqueue.SLURMCluster:
    """Return a cluster whose jobs are submitted; raises InputError with Slurm's words if it refuses such jobs."""
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
        "death_timeout": 20,  # seconds that a worker looks for a client that is gone, before its job ends
        "log_directory": str(log_folder()),
        "scheduler_options": {"dashboard": False, "dashboard_address": "127.0.0.1:0"},
        "silence_logs": logging.CRITICAL,
    }


def log_folder() -> Path:
    """Return where the jobs' own output goes; that of stages is in their logs."""
    return cache_folder() / "slurm"


class SlurmWatch:
    """Says that a run waits for Slurm, submits jobs again that have ended, and notices when none is left."""

    def __init__(self, cluster: dask_jobqueue.SLURMCluster, jobs: int):
        self._cluster, self._jobs = cluster, jobs
        self._started = self._looked = self._well = time.monotonic()
        self._announced = False

    def look(self) -> None:
        """Look at the jobs if it is time to; raises RunError if for a minute there was none."""
        now = time.monotonic()
        has_workers = bool(self._cluster.scheduler_info["workers"])
        if not self._announced and not has_workers and now - self._started >= _ANNOUNCED_AFTER_S:
            self._announced = True
            print(f"waiting for Slurm to start a job, of {self._jobs}", file=sys.stderr, flush=True)
        if now - self._looked < _LOOK_EVERY_S:
            return
        self._looked = now
        self._cluster.scale(jobs=self._jobs)  # what Dask has noticed as lost is submitted again
        if has_workers or self._has_jobs():
            self._well = now
        elif now - self._well >= _LOST_AFTER_S:
            raise RunError(f"Slurm has ended all jobs, and none is at work: their logs are in {log_folder()}")

    def _has_jobs(self) -> bool:
        """Return whether a job of this cluster waits or runs; true where Slurm does not answer."""
        numbers = {str(job.job_id) for job in self._cluster.workers.values()}
        command = ["squeue", "--me", "--noheader", "--format=%i"]
        try:
            answer = subprocess.run(command, capture_output=True, text=True, check=True, timeout=30)
        except (OSError, subprocess.SubprocessError):
            return True
        return not numbers.isdisjoint(answer.stdout.split())
