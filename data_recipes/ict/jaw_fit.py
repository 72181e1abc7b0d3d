"""A real jaw out of linear shapes: in each the lower teeth move rigidly, by a rotation and a slide.

The skin follows by weights that are read off jawOpen. An offset in the resting jaw's frame makes up the difference, so
that each jaw shape alone, in full, is the model's to rounding.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from data_recipes.deformers.jaw import turn
from data_recipes.deformers.surface_operators import smooth_values
from replicate.base.exceptions import InputError

JAW_CONTROLS = ("jawOpen", "jawForward", "jawLeft", "jawRight")
SMOOTHING_PASSES = 6
SOFTNESS_MM2 = 1.0  # of the weights' least squares: near the axis, where the jaw moves nothing, the weight goes to 0
SMALLEST_TURN = 1e-3  # of a rotation matrix less the identity; smaller ones don't tell the pivot


@dataclass(frozen=True)
class JawFit:
    """A jaw.

    pivot: the point of jawOpen's axis nearest to the origin, mm.
    turn_rad, slide_mm: rotation vectors and translations of `JAW_CONTROLS` at 1.
    weight: each vertex's share in the motion, 1 on the lower teeth, 0 on the upper ones.
    offsets: by control, mm in the resting jaw's frame.
    """

    pivot: Float[np.ndarray, " 3"]
    turn_rad: Float[np.ndarray, "4 3"]
    slide_mm: Float[np.ndarray, "4 3"]
    weight: Float[np.ndarray, " n"]
    offsets: dict[str, Float[np.ndarray, "n 3"]]


def fit_jaw(
    x: Float[np.ndarray, "n 3"],
    shapes: dict[str, Float[np.ndarray, "n 3"]],
    lower: Int[np.ndarray, " l"],
    still: Int[np.ndarray, " s"],
    graph: sp.csr_matrix,
) -> JawFit:
    """Fit the jaw to its shapes.

    x: the neutral, mm.
    shapes: the offsets of `JAW_CONTROLS` from it, mm.
    lower, still: the vertices of the lower and of the upper teeth.
    graph: of the mesh's edges, for smoothing.
    Raises InputError when a shape is missing or jawOpen turns nothing.
    """
    for name in JAW_CONTROLS:
        if name not in shapes:
            raise InputError(f"expressions: there is no '{name}', expected {', '.join(JAW_CONTROLS)}")
    motions = [_rigid(x[lower], x[lower] + shapes[name][lower]) for name in JAW_CONTROLS]
    pivot = _pivot(*motions[0])
    turns = np.array([Rotation.from_matrix(rotation.T).as_rotvec() for rotation, _ in motions])
    slides = np.array([pivot @ rotation + shift - pivot for rotation, shift in motions])
    if np.linalg.norm(turns[0]) < SMALLEST_TURN:
        raise InputError(f"expressions: '{JAW_CONTROLS[0]}' doesn't turn the lower teeth, expected a rotation")
    weight = _weights(x, shapes[JAW_CONTROLS[0]], pivot, turns[0], slides[0], lower, still, graph)
    offsets = {}
    for name, rotation, slide in zip(JAW_CONTROLS, turns, slides, strict=True):
        pose = x + shapes[name] - pivot - weight[:, None] * slide
        offsets[name] = turn_vectors(pose, -weight[:, None] * rotation) + pivot - x
        offsets[name][np.concatenate([lower, still])] = 0.0
    return JawFit(pivot, turns, slides, weight, offsets)


def turn_vectors(vectors: Float[np.ndarray, "n 3"], rotation: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Turn vectors by rotation vectors, with the jaw deformer's series."""
    planes = (jnp.asarray(a.T[None], jnp.float32) for a in (vectors, rotation))
    return np.asarray(turn(*planes), np.float64)[0].T


def _rigid(
    source: Float[np.ndarray, "l 3"], target: Float[np.ndarray, "l 3"]
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"]]:
    """Return the rotation R and translation t, for row vectors, that best carry one set of points to another."""
    from_centre, to_centre = source.mean(axis=0), target.mean(axis=0)
    rotation = Rotation.align_vectors(target - to_centre, source - from_centre)[0].as_matrix().T
    return rotation, to_centre - from_centre @ rotation


def _pivot(rotation: Float[np.ndarray, "3 3"], shift: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"]:
    """Return the point of a motion's axis that is nearest to the origin."""
    return np.linalg.lstsq((rotation - np.eye(3)).T, -shift, rcond=SMALLEST_TURN)[0]


def _weights(x, offset, pivot, rotation, slide, lower, still, graph) -> Float[np.ndarray, " n"]:
    """Return each vertex's share in jawOpen, 0 … 1, at which it comes nearest to the shape on its arc."""
    weight = np.zeros(len(x))
    for _ in range(6):  # Gauss–Newton on the arc
        arm = turn_vectors(x - pivot, weight[:, None] * rotation)
        tangent = np.cross(rotation, arm) + slide
        missing = offset + x - pivot - arm - weight[:, None] * slide
        gradient = (tangent * missing).sum(1) - SOFTNESS_MM2 * weight
        weight = np.clip(weight + gradient / ((tangent**2).sum(1) + SOFTNESS_MM2), 0.0, 1.0)
    is_tooth = np.zeros(len(x), bool)
    is_tooth[lower] = is_tooth[still] = True
    weight[lower], weight[still] = 1.0, 0.0
    return np.clip(smooth_values(weight, graph, SMOOTHING_PASSES, is_tooth), 0.0, 1.0)
