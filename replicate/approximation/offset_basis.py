"""Principal components of vertex offsets, and how many of them a face needs."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Float64
from sklearn.decomposition import PCA
from threadpoolctl import threadpool_limits

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
    """Return up to `most` principal components of some offsets; poses all alike have one, of no variance."""
    flat = offsets.reshape(len(offsets), -1)
    with threadpool_limits(1):
        pca = PCA(min(most, *flat.shape), svd_solver="full").fit(flat)
    variances = pca.explained_variance_.astype(np.float64)
    count = max(1, int((variances > SMALLEST * variances[0]).sum()))
    total = float(flat.var(axis=0, ddof=1, dtype=np.float64).sum())
    shapes = np.ascontiguousarray(pca.components_[:count], np.float32)
    return OffsetBasis(shapes, pca.mean_.astype(np.float32), variances[:count], total)


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
