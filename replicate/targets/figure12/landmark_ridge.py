"""A baseline of performance capture: ridge regression from landmarks straight to rig parameters, without a model."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32

from replicate.inverse.ik_training import Truth

STRENGTHS = (1e-4, 1e-3, 1e-2, 1e-1, 1.0)  # λ of the penalty that are tried, over the number of samples


@dataclass(frozen=True)
class LandmarkRidge:
    """Parameters as a straight line of landmarks' moves. weights: (2l, m); constant: (m,); rest: (l, 2) mm."""

    weights: np.ndarray
    constant: np.ndarray
    rest: np.ndarray

    def solve(self, targets: Float[np.ndarray, "t l 3"]) -> Float32[np.ndarray, "t m"]:
        """Return rig parameters for landmarks that shall go to some places, mm."""
        moves = (targets[..., :2] - self.rest).reshape(len(targets), -1)
        return (moves @ self.weights + self.constant).astype(np.float32)


def fit_ridge(
    truth: Truth,
    params: Float[np.ndarray, "a m"],
    held_out: Float[np.ndarray, "b m"],
    rest: Float[np.ndarray, "l 3"],
    ranges: Float[np.ndarray, " m"],
    noise_mm: float,
    generator: np.random.Generator,
) -> LandmarkRidge:
    """Fit the line to the samples that the IK networks are trained on, with the noise that they see.

    truth: where the landmarks are in training and validation poses. params, held_out: the parameters of these. ranges:
    of the parameters; the penalty is the one whose parameters are nearest to the held-out ones in shares of them.
    noise_mm: each coordinate of a landmark moves by U(−noise_mm, noise_mm).
    """
    from sklearn.linear_model import Ridge

    def moves(places: np.ndarray) -> np.ndarray:
        noisy = places + generator.uniform(-noise_mm, noise_mm, places.shape)
        return (noisy - rest)[..., :2].reshape(len(places), -1)

    training, validation = moves(truth.training), moves(truth.validation)
    fits = [Ridge(alpha=strength * len(training)).fit(training, params / ranges) for strength in STRENGTHS]
    best = min(fits, key=lambda fit: float(np.square(fit.predict(validation) - held_out / ranges).mean()))
    return LandmarkRidge((best.coef_.T * ranges), best.intercept_ * ranges, np.asarray(rest[:, :2], float))
