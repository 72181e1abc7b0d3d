"""Posing (§5.3.1): the rig parameters that control points lead to, and how far an approximation is from the rig there.

Whether the mesh is where the user drags it is one question; whether the approximation is the rig there is another, and
the paper's Table 4 answers that one.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32

from data_recipes.rig import Rig
from replicate.approximation.evaluation import Errors, evaluate
from replicate.inverse.control_points import ControlPoints


@dataclass(frozen=True)
class Posed:
    """What inverse kinematics makes of some configurations. params: (k, m). vertices: (k, n, 3), the rig's, mm."""

    params: np.ndarray
    vertices: np.ndarray


def pose(rig: Rig, params: Float[np.ndarray, "k m"]) -> Posed:
    """Return the rig at parameters that inverse kinematics gave."""
    return Posed(np.asarray(params, np.float32), rig(params))


def point_errors_mm(
    posed: Posed, targets: Float[np.ndarray, "k c 3"], points: ControlPoints, axes: int
) -> Float32[np.ndarray, "k c"]:
    """Return how far the rig's control points are from where they shall go, mm, in the coordinates that count."""
    apart = (posed.vertices[:, points.vertices] - targets)[..., :axes]
    return np.linalg.norm(apart, axis=-1).astype(np.float32)


def outside_share(rig: Rig, posed: Posed, points: ControlPoints) -> float:
    """Return the share of the driven parameters that lie outside their controls' limits."""
    driven = points.driven()
    values, slack = posed.params[:, driven], 1e-5 * (rig.upper - rig.lower)[driven]
    return float(((values < rig.lower[driven] - slack) | (values > rig.upper[driven] + slack)).mean())


def approximation_errors(
    rig: Rig, posed: Posed, predictors: Mapping[str, Callable], rigid: list[int], batch: int
) -> dict[str, Errors]:
    """Return each method's distance and normal errors (Eq. 11) against the rig, both at the same parameters.

    predictors: name → (params, true vertices) → vertices, rigid segments placed. A configuration that leads to the same
    parameters as another counts once.
    """
    return evaluate(rig.mesh, posed.params, posed.vertices - rig.mesh.neutral, predictors, rigid, batch)
