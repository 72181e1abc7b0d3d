"""Write a file whole or not at all: under a name of its own beside its place, then renamed into it."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from replicate.engine.full_disk import shortage_number


@contextmanager
def replacing(file: Path, durable: bool = False) -> Iterator[Path]:
    """Yield a path to write to, which takes the place of `file` when the block ends and goes away if it fails.

    The path is `.new-…-<name>` in the folder of `file` and ends as `file` does: some writers look at the ending, or add
    their own. durable: wait until the contents are on the disk, or a power cut could leave the new name with half of
    them. Raises OSError, naming `file`, where it can't be written; one with a number where the disk is full.
    """
    file = Path(file)
    new = file.with_name(f".new-{os.urandom(4).hex()}-{file.name[-60:]}")  # a folder's names end at 255 bytes
    try:
        yield new
        if durable:
            with open(new, "rb") as stream:
                os.fsync(stream.fileno())
        os.replace(new, file)
    except OSError as error:
        number = shortage_number(error, file.parent) or error.errno
        if error.filename not in (None, str(new)) or number is None:
            raise
        raise OSError(number, os.strerror(number), str(file)) from error
    finally:
        with suppress(OSError):
            new.unlink()


def write_bytes(file: Path, data: bytes, durable: bool = False) -> None:
    """Write a file of bytes, whole or not at all."""
    with replacing(file, durable) as new:
        new.write_bytes(data)


def write_text(file: Path, text: str, durable: bool = False) -> None:
    """Write a text in UTF-8, its line ends as they are, whole or not at all."""
    write_bytes(file, text.encode("utf-8"), durable)


def copy_file(source: Path, target: Path) -> None:
    """Copy a file's contents, whole or not at all."""
    with replacing(target) as new:
        shutil.copyfile(source, new)
