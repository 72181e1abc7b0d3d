"""What one pose costs the fast evaluation: the multiplications that are really done, and the bytes of weights read."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np


class Work(NamedTuple):
    """multiplications: products of a weight or a share with what it weighs. read_bytes: of weights, bases and lists of
    pixels; each counts once, though small ones are read again from the nearest cache.
    """

    multiplications: int
    read_bytes: int


def total(parts: Iterable[Work]) -> Work:
    """Return the sum of some work."""
    parts = list(parts)
    return Work(sum(part.multiplications for part in parts), sum(part.read_bytes for part in parts))


def of_layers(inputs: np.ndarray, widths: Sequence[int], itemsize: int) -> Work:
    """Return the work of dense layers one after the other: rows of weights for inputs that are zero are left out.

    inputs: of the first layer; the others' are never zero. widths: of the layers' outputs. itemsize: bytes of a weight.
    """
    rows = [int(np.count_nonzero(inputs)), *widths[:-1]]
    products = sum(int(row) * int(width) for row, width in zip(rows, widths, strict=True))
    return Work(products, products * itemsize)
