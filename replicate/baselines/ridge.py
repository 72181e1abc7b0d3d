"""Ridge regression on products of controls, and the basis that its offsets are fitted in."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float32, Float64
from scipy.linalg import cho_factor, cho_solve
from sklearn.decomposition import PCA
from threadpoolctl import threadpool_limits
from torch import nn

from replicate.approximation.model import SegmentedModel
from replicate.approximation.segments import Segment
from replicate.baselines.line import Line

ROWS = 512  # of a kernel at a time


def product_features(inputs: Float[np.ndarray, "b m"]) -> Float64[np.ndarray, "b k"]:
    """Return the features φ of each row as columns: for few inputs, and for comparison with `product_kernel`."""
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
    """A fit.

    inputs: (N, m), those that it was fitted to. weights: (N, d), of these. means: (N,), of the kernel's rows before it
    was centred; None for a fit through zero. constant: (d,), the targets' mean, or zeros.
    """

    inputs: np.ndarray
    weights: np.ndarray
    means: np.ndarray | None
    constant: np.ndarray

    def __call__(self, inputs: Float[np.ndarray, "b m"]) -> Float64[np.ndarray, "b d"]:
        """Return the fit's predictions for some inputs."""
        kernel = product_kernel(inputs, self.inputs)
        if self.means is not None:
            kernel -= kernel.mean(1, keepdims=True)
            kernel -= self.means - self.means.mean()
        return kernel @ self.weights + self.constant

    def matrix(self) -> Float64[np.ndarray, "k d"]:
        """Return the weights of the features themselves, in the order of `product_features`, of a fit through zero."""
        starts = range(0, len(self.inputs), ROWS)
        parts = ((self.inputs[start : start + ROWS], self.weights[start : start + ROWS]) for start in starts)
        return sum(product_features(inputs).T @ weights for inputs, weights in parts)


def product_ridges(
    inputs: Float[np.ndarray, "n m"],
    targets: Float[np.ndarray, "n d"],
    strengths: tuple[float, ...],
    through_zero: bool = False,
) -> Iterator[ProductRidge]:
    """Yield the fit for each strength λ; each takes a factorisation of an n × n matrix.

    through_zero: whether there is no constant, so that inputs of zero give zero.
    """
    inputs = np.asarray(inputs, np.float64)
    gram, n = product_kernel(inputs, inputs), len(inputs)
    means, constant = None, np.zeros(targets.shape[1])
    if not through_zero:
        means, constant = gram.mean(0), targets.mean(0, dtype=np.float64)
        gram -= means
        gram -= means[:, None] - means.mean()
    matrix = np.empty_like(gram)
    for strength in strengths:
        np.copyto(matrix, gram)
        matrix.flat[:: n + 1] += n * strength
        factor = cho_factor(matrix.T, lower=True, overwrite_a=True, check_finite=False)
        yield ProductRidge(inputs, cho_solve(factor, targets - constant, check_finite=False), means, constant)


# Regressions from rig parameters to targets: straight lines, squares and moduli, and all products of two parameters.

FITS = ("linear", "squares", "products")

Fit = Callable[[np.ndarray], np.ndarray]  # inputs (b, m) → targets (b, d)


def feature_count(name: str, inputs: int) -> int:
    """Return how many features a fit makes of its inputs."""
    return {"linear": inputs, "squares": 3 * inputs, "products": inputs * (inputs + 5) // 2}[name]


def explicit_features(name: str, inputs: Float[np.ndarray, "b m"]) -> Float64[np.ndarray, "b k"]:
    """Return the features x, or x, |x| and x², of the two fits that have a column for each."""
    x = np.asarray(inputs, np.float64)
    return x if name == "linear" else np.concatenate([x, np.abs(x), x * x], axis=1)


def ridges(
    name: str, inputs: Float[np.ndarray, "n m"], targets: Float[np.ndarray, "n d"], strengths: tuple[float, ...]
) -> Iterator[Fit]:
    """Yield the fit of that name for each strength λ."""
    from sklearn.linear_model import Ridge

    if name == "products":
        yield from product_ridges(inputs, targets, strengths)
        return
    features = explicit_features(name, inputs)
    for strength in strengths:
        model = Ridge(alpha=len(inputs) * strength).fit(features, targets)
        yield lambda x, model=model: model.predict(explicit_features(name, x))


def closest(
    fits: Iterable[tuple[float, Fit]], inputs: Float[np.ndarray, "b m"], targets: Float[np.ndarray, "b d"]
) -> tuple[float, Fit]:
    """Return that of some (strength, fit) pairs whose fit has the smallest squared error."""
    errors = ((float(np.square(fit(inputs) - targets).sum()), strength, fit) for strength, fit in fits)
    _, strength, fit = min(errors, key=lambda entry: entry[0])
    return strength, fit


# Principal components of vertex offsets, and how many of them a face needs.

SMALLEST = 1e-12  # of the largest variance: below it a component is rounding


@dataclass(frozen=True)
class OffsetBasis:
    """Principal components of offsets.

    shapes: (c, 3n) float32, orthonormal, the one of the largest variance first. mean: (3n,) float32, mm. variances:
    (c,) float64, of the offsets along each shape, mm². total: the variance of all offsets, mm².
    """

    shapes: np.ndarray
    mean: np.ndarray
    variances: np.ndarray
    total: float

    def project(self, offsets: Float[np.ndarray, "b n 3"]) -> Float32[np.ndarray, "b c"]:
        """Return the coefficients, mm, of those offsets in the span of the shapes that are closest."""
        return (np.asarray(offsets, np.float32).reshape(len(offsets), -1) - self.mean) @ self.shapes.T

    def restore(self, coefficients: Float[np.ndarray, "b k"]) -> Float32[np.ndarray, "b n 3"]:
        """Return the offsets of some coefficients, mm, which may be those of the first shapes only."""
        flat = np.asarray(coefficients, np.float32) @ self.shapes[: coefficients.shape[1]] + self.mean
        return flat.reshape(len(flat), -1, 3)


def principal_components(offsets: Float32[np.ndarray, "b n 3"], most: int) -> OffsetBasis:
    """Return up to `most` principal components of some offsets; one, of no variance, where all poses are alike."""
    flat = offsets.reshape(len(offsets), -1)
    with threadpool_limits(1):
        pca = PCA(min(most, *flat.shape), svd_solver="full").fit(flat)
    variances = pca.explained_variance_.astype(np.float64)
    count = max(1, int((variances > SMALLEST * variances[0]).sum()))
    total = float(flat.var(axis=0, ddof=1, dtype=np.float64).sum())
    shapes = np.ascontiguousarray(pca.components_[:count], np.float32)
    return OffsetBasis(shapes, pca.mean_.astype(np.float32), variances[:count], total)


def components_of_variance(variances: Float64[np.ndarray, " c"], total: float, share: float) -> int | None:
    """Return how many components hold a share of the variance; None where all of them hold less."""
    enough = np.flatnonzero(np.cumsum(variances) >= share * total)
    return int(enough[0]) + 1 if len(enough) else None


def components_within(error: Callable[[int], float], most: int, limit: float) -> int | None:
    """Return the smallest count of components whose error is within a limit, by bisection; None where there is none.

    error: count → error, which falls as the count grows. most: the largest count to try.
    """
    if error(most) > limit:
        return None
    low, high = 0, most  # the error of `high` is within the limit, that of `low` isn't
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if error(middle) <= limit else (middle, high)
    return high


# Offsets that are linear in p, |p| and p², the features of ridge regression.

FEATURES = 3  # of each parameter


class SquaresLine(nn.Module):
    """(b, j) scaled parameters → (b, k, 3) offsets, a line in the 3j features (p, |p|, p²) of `explicit_features`."""

    def __init__(self, inputs: int, vertices: int):
        super().__init__()
        self.line = Line(FEATURES * inputs, vertices)

    def forward(self, params: Float[torch.Tensor, "b j"]) -> Float[torch.Tensor, "b k 3"]:
        return self.line(torch.cat([params, params.abs(), params.square()], dim=1))


def squares_model(
    segments: Sequence[Segment], weights: Sequence[Float[np.ndarray, "_ _"]], scale: np.ndarray, vertex_count: int
) -> SegmentedModel:
    """Return the model of fits on p, |p| and p².

    weights: a segment's are (3j + 1, 3k), the constant in the last row. scale: (m,), what parameters are divided by.
    """
    networks = []
    for segment, weight in zip(segments, weights, strict=True):
        networks.append(SquaresLine(len(segment.parameters), len(segment.vertices)))
        networks[-1].line.set_weights(weight)
    return SegmentedModel(networks, segments, scale, [1.0] * len(networks), vertex_count)


# Offsets that are linear in those features and in all products of two parameters.


class ProductShapes(nn.Module):
    """(b, m) scaled parameters → (b, k, 3) offsets in mm: features of `product_features` mix c shapes.

    rest: (m,), the scaled parameters of the neutral pose, from which features count, so that it is exact.
    """

    rest: torch.Tensor
    first: torch.Tensor
    second: torch.Tensor

    def __init__(self, rest: torch.Tensor, shapes: int, vertices: int):
        super().__init__()
        count = len(rest)
        self.weights = nn.Linear(feature_count("products", count), shapes, bias=False)
        self.shapes = nn.Linear(shapes, 3 * vertices, bias=False)
        self.register_buffer("rest", rest)
        for name, indices in zip(("first", "second"), np.triu_indices(count, 1), strict=True):
            self.register_buffer(name, torch.from_numpy(indices), persistent=False)

    def forward(self, params: Float[torch.Tensor, "b m"]) -> Float[torch.Tensor, "b k 3"]:
        x = params - self.rest
        pairs = x.index_select(1, self.first) * x.index_select(1, self.second)
        features = torch.cat([x, x.abs(), x.square(), pairs], dim=1)
        return self.shapes(self.weights(features)).unflatten(1, (-1, 3))
