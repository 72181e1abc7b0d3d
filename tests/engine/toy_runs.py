"""Runs of the toy graph in processes of their own, and what is left of them."""

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import psutil

from replicate.engine import store
from replicate.engine.stage import in_order

TESTS = Path(__file__).resolve().parents[1]
TOYS = str(TESTS / "toy_stages.py")


def start(cache, *arguments, **variables) -> subprocess.Popen:
    """Start the toy graph with the arguments of `run_toys`."""
    return launch([sys.executable, TOYS, *map(str, arguments)], cache, **variables)


def launch(command, cache, **variables) -> subprocess.Popen:
    """Start a command that finds the toy stages and the project."""
    path = os.pathsep.join([str(TESTS), str(TESTS.parent)])
    environment = {**os.environ, "REPLICATE_CACHE": str(cache), "PYTHONPATH": path, **variables}
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def wait_for(condition: Callable[[], object], what: str, seconds: float = 120.0):
    """Return what `condition` returns once that is true."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        if outcome := condition():
            return outcome
        time.sleep(0.05)
    raise AssertionError(f"no {what} within {seconds} s")


def contents(cache, stages) -> dict:
    """Return every file that the stages' functions wrote, by its checksum."""
    folders = {stage.title: cache / stage.identifier for stage in in_order(stages)}
    return {title: store.read_manifest(folder)["files"] for title, folder in folders.items()}


def own_children() -> list[psutil.Process]:
    """Return this process's children, without the tracker that multiprocessing keeps once it was used."""
    return [one for one in psutil.Process().children() if not _has(one, "multiprocessing.resource_tracker")]


def gone(processes: list[psutil.Process]) -> bool:
    """Return whether all these processes have ended, whoever has yet to take note of it."""
    with contextlib.suppress(psutil.NoSuchProcess):
        return all(not one.is_running() or one.status() == psutil.STATUS_ZOMBIE for one in processes)
    return gone([one for one in processes if one.is_running()])


def processes_of(folder: Path, program: str = "") -> list[psutil.Process]:
    """Return the processes whose environment or command names a folder, and whose command names a program."""
    processes = []
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error):
            command = " ".join(process.cmdline())
            matches = str(folder) in command or any(str(folder) in value for value in process.environ().values())
            if matches and program in command and process.status() != psutil.STATUS_ZOMBIE:
                processes.append(process)
    return processes


def dask_workers_at_work(folder: Path) -> list[psutil.Process]:
    """Return the Dask workers of a local cluster that watch over a stage.

    While such a worker starts it has other children for a moment; killed then, it ends the whole run.
    """
    return [process for process in processes_of(folder, "spawn_main") if _stages_below(process)]


def _stages_below(process: psutil.Process) -> list[psutil.Process]:
    try:
        return [child for child in process.children() if _has(child, "replicate.engine.worker")]
    except psutil.NoSuchProcess:  # it has ended meanwhile
        return []


def _has(process: psutil.Process, words: str) -> bool:
    """Return whether a process is there whose command has these words."""
    with contextlib.suppress(psutil.Error):
        return words in " ".join(process.cmdline())
    return False


def survivors(folder: Path, seconds: float = 10.0) -> list[str]:
    """Return the commands of the processes that still name a folder after a while; they are killed."""
    _, alive = psutil.wait_procs(processes_of(folder), timeout=seconds)
    for process in alive:
        with contextlib.suppress(psutil.Error):
            process.kill()
    return [f"{process.pid} {process.name()}" for process in alive]
