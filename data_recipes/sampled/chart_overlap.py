"""Whether charts overlap: the share of the unit square that triangles cover, and of that what they cover twice."""

import numpy as np
from jaxtyping import Float

TEXELS = 256  # a side


def covered_and_doubled(corners: Float[np.ndarray, "f 3 2"]) -> tuple[float, float]:
    """Return which share of the unit square triangles cover, and which share of that more than one of them covers.

    A texel counts for each triangle that its middle lies in; one on an edge belongs to neither side.
    """
    counts = np.zeros((TEXELS, TEXELS), np.int32)  # row: v
    places = corners * TEXELS - 0.5
    low = np.clip(np.ceil(places.min(axis=1)).astype(int), 0, TEXELS)
    high = np.clip(np.floor(places.max(axis=1)).astype(int) + 1, 0, TEXELS)
    for triangle in np.flatnonzero((high > low).all(axis=1)):
        (left, lower), (right, upper) = low[triangle].tolist(), high[triangle].tolist()
        counts[lower:upper, left:right] += _inside(places[triangle], left, right, lower, upper)
    covered = counts > 0
    return float(covered.mean()), float((counts > 1).sum() / max(covered.sum(), 1))


def _inside(triangle: np.ndarray, left: int, right: int, lower: int, upper: int) -> np.ndarray:
    """Return (rows, columns) bool: which of some texels' middles lie within a triangle, either way round."""
    x, y = np.arange(left, right)[None, :], np.arange(lower, upper)[:, None]
    sides = []
    for (ax, ay), (bx, by) in zip(triangle, np.roll(triangle, -1, axis=0), strict=True):
        sides.append((bx - ax) * (y - ay) - (by - ay) * (x - ax))
    a, b, c = sides
    return ((a > 0) & (b > 0) & (c > 0)) | ((a < 0) & (b < 0) & (c < 0))
