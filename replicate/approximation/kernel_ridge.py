"""Ridge regression on all products of two inputs, in its dual form: 34,000 features without a column for any of them.

The features of inputs x (m,) are φ(x) = (x_i, |x_i|, x_i², x_i x_j for i < j), m (m + 5) / 2 of them. Their inner
products have a closed form,

    φ(x)·φ(y) = x·y + |x|·|y| + x²·y² + ((x·y)² − x²·y²) / 2,

and W = argmin ‖Φ W − Y‖² / N + λ ‖W‖² needs nothing else: with Φ and Y centred, so that the constant is not penalised,
W = Φᵀ (K + NλI)⁻¹ Y for the N × N matrix K = Φ Φᵀ.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64

ROWS = 512  # of a kernel at a time


def product_features(inputs: Float[np.ndarray, "b m"]) -> Float64[np.ndarray, "b k"]:
    """Return the features φ of each row, one column each: for few inputs, and to compare `product_kernel` with."""
    x = np.asarray(inputs, np.float64)
    first, second = np.triu_indices(x.shape[1], 1)
    return np.concatenate([x, np.abs(x), x * x, x[:, first] * x[:, second]], axis=1)


def product_kernel(left: Float[np.ndarray, "a m"], right: Float[np.ndarray, "b m"]) -> Float64[np.ndarray, "a b"]:
    """Return φ(x)·φ(y) of every row x of one matrix and every row y of another."""
    x, y = (np.asarray(part, np.float64) for part in (left, right))
    wide_x, wide_y = (np.concatenate([part, np.abs(part), part * part / np.sqrt(2)], axis=1) for part in (x, y))
    kernel = np.empty((len(x), len(y)))
    for start in range(0, len(x), ROWS):
        rows = slice(start, start + ROWS)
        products = x[rows] @ y.T
        products *= products
        products *= 0.5
        np.matmul(wide_x[rows], wide_y.T, out=kernel[rows])
        kernel[rows] += products
    return kernel


@dataclass(frozen=True)
class ProductRidge:
    """A fit: inputs (N, m) it stands on, its weights (N, d) on them, and what centres features and targets.

    means: (N,) each row's mean of the kernel before it was centred; constant: (d,), the targets' mean.
    """

    inputs: np.ndarray
    weights: np.ndarray
    means: np.ndarray
    constant: np.ndarray

    def __call__(self, inputs: Float[np.ndarray, "b m"]) -> Float64[np.ndarray, "b d"]:
        """Return what the fit predicts for some inputs."""
        kernel = product_kernel(inputs, self.inputs)
        kernel -= kernel.mean(1, keepdims=True)
        kernel -= self.means - self.means.mean()
        return kernel @ self.weights + self.constant


def product_ridges(
    inputs: Float[np.ndarray, "n m"], targets: Float[np.ndarray, "n d"], strengths: tuple[float, ...]
) -> Iterator[ProductRidge]:
    """Yield the fit for each strength λ, one factorisation of an n × n matrix each."""
    from scipy.linalg import cho_factor, cho_solve

    inputs = np.asarray(inputs, np.float64)
    gram, n = product_kernel(inputs, inputs), len(inputs)
    means, constant = gram.mean(0), targets.mean(0, dtype=np.float64)
    gram -= means
    gram -= means[:, None] - means.mean()
    matrix = np.empty_like(gram)
    for strength in strengths:
        np.copyto(matrix, gram)
        matrix.flat[:: n + 1] += n * strength
        factor = cho_factor(matrix.T, lower=True, overwrite_a=True, check_finite=False)
        yield ProductRidge(inputs, cho_solve(factor, targets - constant, check_finite=False), means, constant)
