"""Checkpoints that begin with a checksum of what follows: a damaged one counts as none, and is named."""

import hashlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO, TypeVar

from replicate.engine.atomic_files import replacing

Contents = TypeVar("Contents")
_BEGIN, _END = b"sha256:", b"\n"
_SEAL_BYTES = len(_BEGIN) + 64 + len(_END)


def write_sealed(file: Path, write: Callable[[BinaryIO], object]) -> None:
    """Write a file with its checksum in the first line; it is there as a whole, also after a power cut, or not at all.

    write: called with a binary stream, after the first line, to write the contents to.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    with replacing(file, durable=True) as new, open(new, "w+b") as stream:
        stream.write(b" " * _SEAL_BYTES)
        write(stream)
        seal = _seal(stream)
        stream.seek(0)
        stream.write(seal)


def read_sealed(file: Path, read: Callable[[BinaryIO], Contents]) -> Contents | None:
    """Return what a reader makes of a sealed file, or None if there is none or it is damaged.

    read: called with a binary stream at the first byte of the contents. Damage is named on standard error, in one line.
    """
    try:
        with open(file, "rb") as stream:
            if _seal(stream) == _first_line(stream):
                return read(stream)
        damage = "differs from its checksum"
    except FileNotFoundError:
        return None
    except OSError as error:
        damage = f"can't be read: {error.strerror}"
    print(f"{file}: damaged ({damage}); the work is done again from the last sound state", file=sys.stderr, flush=True)
    return None


def _seal(stream: BinaryIO) -> bytes:
    stream.seek(_SEAL_BYTES)
    return _BEGIN + hashlib.file_digest(stream, "sha256").hexdigest().encode() + _END


def _first_line(stream: BinaryIO) -> bytes:
    """Return the seal that a stream carries and leave the stream behind it."""
    stream.seek(0)
    return stream.read(_SEAL_BYTES)
