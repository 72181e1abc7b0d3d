"""Regressions from rig parameters to targets: straight lines, squares and moduli, and all products of two parameters.

Each is W = argmin ‖Φ W − Y‖² / N + λ ‖W‖² on its features Φ, with a constant that is not penalised.
"""

from collections.abc import Callable, Iterable, Iterator

import numpy as np
from jaxtyping import Float, Float64

from replicate.approximation.kernel_ridge import product_ridges

FITS = ("linear", "squares", "products")

Fit = Callable[[np.ndarray], np.ndarray]  # inputs (b, m) → targets (b, d)


def feature_count(name: str, inputs: int) -> int:
    """Return how many features a fit has of so many inputs."""
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
    """Return (strength, fit) of the fit with the smallest squared error, of some (strength, fit) pairs."""
    errors = ((float(np.square(fit(inputs) - targets).sum()), strength, fit) for strength, fit in fits)
    _, strength, fit = min(errors, key=lambda entry: entry[0])
    return strength, fit
