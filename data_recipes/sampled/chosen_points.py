"""Landmarks and control points for a face that names none: vertices that are far apart and move much.

Half of the vertices, those that move more than the median one, are candidates. The first point is the one that moves
most, each further one that which lies farthest from all before it, at rest. The region of a control point is that of
the controls which move it most, by a straight line through the poses.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Float64, Int

LANDMARKS, CONTROL_POINTS = 24, 20
POSES = 500  # most that are looked at
RIDGE = 1e-3  # of the mean square of a column


def motion_mm(offsets: Float[np.ndarray, "b n 3"]) -> Float64[np.ndarray, " n"]:
    """Return how far each vertex moves: the root mean square over poses."""
    return np.sqrt((np.asarray(offsets, np.float64) ** 2).sum(axis=2).mean(axis=0))


def spread_out(neutral: Float[np.ndarray, "n 3"], motion: Float[np.ndarray, " n"], count: int) -> Int[np.ndarray, " k"]:
    """Return up to `count` vertices that move more than the median one, far apart."""
    candidates = np.flatnonzero(motion >= np.median(motion))
    places = np.asarray(neutral[candidates], np.float64)
    chosen = [int(np.argmax(motion[candidates]))]
    distance = ((places - places[chosen[0]]) ** 2).sum(axis=1)
    while len(chosen) < min(count, len(candidates)):
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, ((places - places[chosen[-1]]) ** 2).sum(axis=1))
    return candidates[chosen].astype(np.int32)


def regions_of(
    params: Float[np.ndarray, "b m"], offsets: Float[np.ndarray, "b k 3"], regions: Sequence[str]
) -> tuple[str, ...]:
    """Return the region of the controls that move each of k points most.

    params: less their defaults. regions: each control's. The controls' effects are those of a ridge regression.
    """
    x = np.asarray(params, np.float64)
    size = np.sqrt((x**2).mean(axis=0))
    x = x / np.where(size > 0, size, 1.0)
    y = np.asarray(offsets, np.float64).reshape(len(x), -1)
    effects = np.linalg.solve(x.T @ x + RIDGE * len(x) * np.eye(x.shape[1]), x.T @ y)  # (m, 3 k)
    strength = (effects**2).reshape(x.shape[1], -1, 3).sum(axis=2)  # (m, k)
    names = list(dict.fromkeys(regions))
    own = np.array([names.index(region) for region in regions])
    sums = np.stack([strength[own == k].sum(axis=0) for k in range(len(names))])  # (r, k)
    return tuple(names[k] for k in sums.argmax(axis=0))
