"""Pictures that several processes of one command want, drawn once: a run's figures, and its notebook in a kernel."""

import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from replicate.engine.atomic_files import replacing
from replicate.engine.folders import short_temporary_folder

PLACE = "REPLICATE_PICTURES"  # the variable that names the folder to processes that are started meanwhile

Picture = UInt8[np.ndarray, "h w 3"]


@contextmanager
def shared_pictures() -> Iterator[None]:
    """Have this process, and those that it starts within, draw a picture once; what is shared is gone at the end."""
    before = os.environ.get(PLACE)
    with short_temporary_folder() as folder:
        os.environ[PLACE] = str(folder)
        try:
            yield
        finally:
            os.environ.pop(PLACE)
            if before is not None:
                os.environ[PLACE] = before


def drawn_once(draw: Callable[[], Picture], *what: Any) -> Picture:
    """Return the picture of `what` (numbers, texts, arrays, dataclasses and sequences of them), drawn if it is new.

    Outside of `shared_pictures` it is always drawn.
    """
    place = os.environ.get(PLACE)
    if place is None or not Path(place).is_dir():
        return draw()
    digest = hashlib.sha256()
    _add(digest, what)
    file = Path(place) / f"{digest.hexdigest()}.npy"
    if file.is_file():
        return np.load(file, allow_pickle=False)
    picture = draw()
    with suppress(OSError), replacing(file) as new:  # a full disk costs time alone
        np.save(new, picture)
    return picture


def _add(digest: Any, value: Any) -> None:
    """Add a value to a digest, its type and size first, so that no two values read alike."""
    if is_dataclass(value):
        value = [type(value).__name__, *(getattr(value, field.name) for field in fields(value))]
    if hasattr(value, "__array__"):
        value = np.asarray(value)
        digest.update(f"array {value.dtype} {value.shape} ".encode() + np.ascontiguousarray(value).tobytes())
    elif isinstance(value, list | tuple):
        digest.update(f"sequence {len(value)} ".encode())
        for part in value:
            _add(digest, part)
    else:
        digest.update(f"{value!r} ".encode())
