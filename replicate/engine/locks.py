"""Locks between processes, as files; the system frees one should the process that holds it die."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from replicate.engine.exceptions import InputError
from replicate.engine.full_disk import shortage_number


def check_lock(file: Path) -> None:
    """Raise InputError if something else than a file stands where a lock has to be."""
    if file.exists() and not file.is_file():
        raise InputError(f"{file} is a folder, where only a lock's file is allowed: remove it")


@contextmanager
def hold(file: Path, waiting: Callable[[], None] = lambda: None, wait: bool = True) -> Iterator[None]:
    """Hold a lock; the same process may hold it twice.

    waiting: called once where another process holds it. wait: else, filelock's Timeout is raised then. Raises
    InputError where the file can't be a lock.
    """
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file_lock = FileLock(file, is_singleton=True)
        file_lock.acquire(timeout=0)
    except Timeout:
        if not wait:
            raise
        waiting()
        file_lock.acquire(poll_interval=0.2)
    except OSError as error:
        if shortage_number(error, file.parent):
            raise
        raise InputError(f"{file} can't be locked ({error.strerror}): remove it, or name another folder") from None
    try:
        yield
    finally:
        file_lock.release()
