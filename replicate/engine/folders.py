"""Folders to write to: that one can be written is known before hours of work; one whose path is short, for sockets."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from replicate.engine.exceptions import InputError
from replicate.engine.full_disk import shortage_number

_LONGEST_BYTES = 60  # of a temporary folder's path: a socket's, a random name and its own included, ends at 103


def check_writable(folder: Path, variable: str) -> None:
    """Make a folder, unless it is there, and see that files can be written into it.

    variable: the environment variable that names it. Raises InputError, in one sentence, where nothing can be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return
    except OSError as error:
        if shortage_number(error, folder):
            raise
        file = next((part for part in (folder, *folder.parents) if part.exists() and not part.is_dir()), None)
        reason = f"{file} is a file" if file else error.strerror
    raise InputError(f"{folder} can't be written to ({reason}): set {variable} to a folder that can")


def check_creatable(folder: Path, variable: str) -> None:
    """See that a folder can be written, or made where it isn't there, and leave nothing behind.

    variable, errors: as for `check_writable`.
    """
    check_writable(next(part for part in (folder, *folder.parents) if part.exists()), variable)


@contextmanager
def short_temporary_folder() -> Iterator[Path]:
    """Yield a temporary folder in which a socket can stand: the path of one ends at about a hundred bytes.

    It is in `$TMPDIR` where that is short enough, and goes when the block ends. Raises InputError where there is none.
    """
    parents = [Path(name) for name in (os.environ.get("TMPDIR"), "/tmp", "/var/tmp", "/dev/shm") if name]
    for parent in parents:
        if len(os.fsencode(parent.absolute())) > _LONGEST_BYTES:
            continue
        try:
            folder = tempfile.TemporaryDirectory(dir=parent.absolute(), ignore_cleanup_errors=True)
        except OSError as error:
            if shortage_number(error, parent):
                raise
            continue
        with folder as name:
            yield Path(name)
        return
    raise InputError(
        f"no temporary folder can be made in {' or '.join(map(str, parents))}: set TMPDIR to a folder that can be "
        f"written, with a path of at most {_LONGEST_BYTES} bytes"
    )
