"""Damage as a disk does it: a bit that flips, and nothing that a program sees from outside."""

import os
from pathlib import Path


def flip_a_bit(file: Path, place: float = 0.5) -> None:
    """Flip one bit of a file, at a share of its length; its size and times stay as they were."""
    before = file.stat()
    with open(file, "r+b") as stream:
        stream.seek(min(int(place * before.st_size), before.st_size - 1))
        byte = stream.read(1)[0]
        stream.seek(-1, os.SEEK_CUR)
        stream.write(bytes([byte ^ 1]))
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))
