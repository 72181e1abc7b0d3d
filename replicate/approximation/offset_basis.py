"""Principal components of vertex offsets, and how many of them a face needs."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Float64

COLUMNS = 4096  # of the offsets at a time, as float64
SMALLEST = 1e-12  # of the largest variance: below it a component is rounding


@dataclass(frozen=True)
class OffsetBasis:
    """Orthonormal shapes (c, 3n) float32 by falling variance, around a mean (3n,) float32, mm.

    variances: (c,) float64, mm², of the offsets along each shape; total: that of all offsets, mm².
    """

    shapes: np.ndarray
    mean: np.ndarray
    variances: np.ndarray
    total: float

    def project(self, offsets: Float[np.ndarray, "b n 3"]) -> Float32[np.ndarray, "b c"]:
        """Return the coefficients of the closest offsets that the basis has, mm."""
        return (np.asarray(offsets, np.float32).reshape(len(offsets), -1) - self.mean) @ self.shapes.T

    def restore(self, coefficients: Float[np.ndarray, "b k"]) -> Float32[np.ndarray, "b n 3"]:
        """Return the offsets of some coefficients, mm; of fewer than there are shapes, those of the first ones."""
        flat = np.asarray(coefficients, np.float32) @ self.shapes[: coefficients.shape[1]] + self.mean
        return flat.reshape(len(flat), -1, 3)


def principal_components(offsets: Float32[np.ndarray, "b n 3"], most: int) -> OffsetBasis:
    """Return up to `most` principal components of some offsets, as scikit-learn's PCA has them, signs aside.

    There are fewer poses than coordinates, so the eigenvectors of the poses' b × b products tell them: a tenth of the
    time of a singular value decomposition. Poses all alike have one component, of no variance.
    """
    flat = offsets.reshape(len(offsets), -1)
    mean = flat.mean(0, dtype=np.float64).astype(np.float32)
    flat = flat - mean
    gram = np.zeros((len(flat), len(flat)))
    for start in range(0, flat.shape[1], COLUMNS):
        part = flat[:, start : start + COLUMNS].astype(np.float64)
        gram += part @ part.T
    values, vectors = np.linalg.eigh(gram)
    values, vectors = values[::-1], vectors[:, ::-1]
    count = max(1, int((values[:most] > SMALLEST * values[0]).sum()))
    lengths = np.sqrt(np.where(values[:count] > 0, values[:count], 1))
    shapes = (vectors[:, :count] / lengths).astype(np.float32).T @ flat
    shapes = np.ascontiguousarray(np.linalg.qr(shapes.T)[0].T)  # the last ones are orthogonal up to rounding only
    freedom = max(1, len(flat) - 1)
    return OffsetBasis(shapes, mean, np.maximum(values[:count], 0) / freedom, float(np.trace(gram)) / freedom)


def components_of_variance(variances: Float64[np.ndarray, " c"], total: float, share: float) -> int | None:
    """Return how many components hold a share of the variance; None where all that there are hold less."""
    enough = np.flatnonzero(np.cumsum(variances) >= share * total)
    return int(enough[0]) + 1 if len(enough) else None


def components_within(error: Callable[[int], float], most: int, limit: float) -> int | None:
    """Return the least number of components whose error is at most a limit, by bisection; None where `most` exceed it.

    error: a number of components → their error, which falls with the number.
    """
    if error(most) > limit:
        return None
    low, high = 0, most  # the error of `high` is within the limit, that of `low` isn't
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if error(middle) <= limit else (middle, high)
    return high
