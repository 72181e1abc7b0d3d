"""What a folder of samples may say of its controls, `influence.npy`: which of them moves which vertex.

A program that evaluates the rig can find out by trying; from samples it can only be estimated. It is optional.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Bool

from data_recipes.sampled.shards import DAMAGE
from replicate.engine.exceptions import InputError
from replicate.engine.user_files import shown_path

INFLUENCE_FILE = "influence.npy"


def influence_file(folder: Path) -> tuple[Path, ...]:
    """Return the file of a folder, as a tuple of one, or () where there is none."""
    file = folder / INFLUENCE_FILE
    return (file,) if file.exists() or file.is_symlink() else ()


def read_influence(file: Path, vertices: int, controls: int) -> Bool[np.ndarray, "n m"]:
    """Return which control (a column) moves which vertex (a row). Raises InputError for a file that is anything else.

    A control that moves nothing is allowed: it is idle.
    """
    where = shown_path(file)
    if not file.is_file():
        raise InputError(f"{where}: found no regular file: allowed is an array of true and false, or no such file")
    try:
        moves = np.load(file, mmap_mode="r", allow_pickle=False)
    except (*DAMAGE, OverflowError, MemoryError) as error:
        raise InputError(f"{where}: found no readable npy file ({error})".replace("\n", " ")) from None
    if not isinstance(moves, np.ndarray) or moves.dtype != bool or moves.shape != (vertices, controls):
        found = f"{moves.dtype} {moves.shape}" if isinstance(moves, np.ndarray) else "several arrays"
        allowed = f"true or false (bool) for every vertex and control, ({vertices}, {controls})"
        raise InputError(f"{where}: found {found}: allowed is {allowed}")
    if not moves.any():
        raise InputError(f"{where}: no control moves a vertex: allowed is one at least, or no such file")
    return np.array(moves)
