"""How many cores a measurement may use: all that the process has, or one of them for all of its threads."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import torch
from threadpoolctl import threadpool_limits

TASKS = Path("/proc/self/task")


def can_confine() -> bool:
    """Return whether this system lets a process keep its threads on one core; Linux does."""
    return sys.platform == "linux" and hasattr(os, "sched_setaffinity") and TASKS.is_dir()


def core_total() -> int:
    """Return how many cores the process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def one_core() -> Iterator[None]:
    """Keep all threads of the process on one core while the context lasts, XLA's too, whose number is fixed at start.

    Raises OSError where `can_confine` is False.
    """
    before = os.sched_getaffinity(0)
    with threads(1):
        _keep({min(before)})
        try:
            yield
        finally:
            _keep(before)


@contextmanager
def threads(count: int) -> Iterator[None]:
    """Let BLAS, OpenMP and torch use so many threads while the context lasts."""
    usual = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        with threadpool_limits(count):
            yield
    finally:
        torch.set_num_threads(usual)


def _keep(cores: set[int]) -> None:
    for task in TASKS.iterdir():
        with suppress(ProcessLookupError):  # a thread that has ended since
            os.sched_setaffinity(int(task.name), cores)
