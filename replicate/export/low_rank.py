"""A clip as few shapes and their weights: a small basis that keeps every vertex within a stated distance.

A vertex's offsets over time are nearly linear in a few dozen directions, also where it wrinkles. The singular vectors
of the offsets are the best basis in the mean, but a file promises something about the *worst* vertex. So vertices that
are off are weighted up a few times, which needs a third fewer shapes for the same promise.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Float64

PASSES = 2  # fits of one size, each with the vertices weighted by how far the one before was off
STEP = 1 / 16  # sizes that differ by less than this share count as equal: a try costs more than it saves
LEAST_WEIGHT = 0.03  # a vertex that is exact still counts, so that it stays so
CHUNK_FLOATS = 4_000_000


@dataclass(frozen=True)
class LowRank:
    """Offsets (t, n, 3) ≈ weights (t, k) · shapes (k, n, 3), mm; weights within [-1, 1]; largest error in mm."""

    weights: Float32[np.ndarray, "t k"]
    shapes: Float32[np.ndarray, "k n 3"]
    error_mm: float


def low_rank(offsets: Float32[np.ndarray, "t n 3"], tolerance_mm: float) -> LowRank:
    """Return a factorisation in which no vertex of any frame is further off than the tolerance (mm, above 0)."""
    best, _ = _fit(offsets, 0, np.ones(offsets.shape[1]))
    if best.error_mm <= tolerance_mm:
        return best
    low, most = 0, min(len(offsets), 3 * offsets.shape[1])
    high, scale = min(8, most), np.ones(offsets.shape[1])
    while True:
        best, scale = _fit(offsets, high, scale)
        if best.error_mm <= tolerance_mm or high == most:
            break
        low, high = high, min(2 * high, most)
    while high - low > max(1, STEP * high):
        middle = (low + high) // 2
        trial, scale = _fit(offsets, middle, scale)
        if trial.error_mm <= tolerance_mm:
            best, high = trial, middle
        else:
            low = middle
    return best


def follow(weights: Float32[np.ndarray, "t k"], values: Float32[np.ndarray, "t n 3"]) -> Float32[np.ndarray, "k n 3"]:
    """Return the shapes (k, n, 3) that, with these weights, come closest to other values (normals, say) of the clip."""
    solve = np.linalg.pinv(weights.astype(np.float64)).astype(np.float32)
    return (solve @ values.reshape(len(values), -1)).reshape(weights.shape[1], *values.shape[1:])


def _fit(offsets: np.ndarray, k: int, scale: Float[np.ndarray, " n"]) -> tuple[LowRank, Float[np.ndarray, " n"]]:
    """Return the best fit of rank k from these weights of the vertices on, and the weights to go on with."""
    t, n, _ = offsets.shape
    if k == 0:
        shapes, weights = np.zeros((0, n, 3), np.float32), np.zeros((t, 0), np.float32)
        return LowRank(weights, shapes, float(_errors(offsets, weights, shapes).max())), scale
    best = None
    for _ in range(PASSES):
        directions = np.linalg.eigh(_gram(offsets, scale))[1][:, : -k - 1 : -1]  # (t, k), largest first
        shapes = np.ascontiguousarray(directions.T.astype(np.float32)) @ offsets.reshape(t, -1)
        size = np.abs(directions).max(0)
        weights = (directions / size).astype(np.float32)
        shapes = (shapes * size[:, None].astype(np.float32)).reshape(k, n, 3)
        errors = _errors(offsets, weights, shapes)
        if best is None or errors.max() < best.error_mm:
            best = LowRank(weights, shapes, float(errors.max()))
        scale = scale * np.sqrt(np.maximum(errors / max(errors.max(), 1e-12), LEAST_WEIGHT**2))
        scale = scale / scale.max()
    return best, scale


def _gram(offsets: np.ndarray, scale: Float[np.ndarray, " n"]) -> Float64[np.ndarray, "t t"]:
    """Return the frames' products, vertices weighted; in double precision, since its roots are needed."""
    t, n, _ = offsets.shape
    gram = np.zeros((t, t))
    step = max(1, CHUNK_FLOATS // (3 * t))
    for first in range(0, n, step):
        part = offsets[:, first : first + step] * scale[first : first + step, None]  # float64
        part = part.reshape(t, -1)
        gram += part @ part.T
    return gram


def _errors(offsets: np.ndarray, weights: np.ndarray, shapes: np.ndarray) -> Float64[np.ndarray, " n"]:
    """Return each vertex's largest distance (mm) over the frames, in single precision, as a viewer adds them up."""
    t, n, _ = offsets.shape
    worst = np.zeros(n)
    flat = shapes.reshape(len(shapes), 3 * n)
    step = max(1, CHUNK_FLOATS // (3 * n))
    for first in range(0, t, step):
        part = offsets[first : first + step]
        off = part - (weights[first : first + step] @ flat).reshape(part.shape)
        worst = np.maximum(worst, np.sqrt((off.astype(np.float64) ** 2).sum(-1)).max(0))
    return worst
