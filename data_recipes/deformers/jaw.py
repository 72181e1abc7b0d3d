"""The jaw: rotation about its pivot and translation, shared out by harmonic weights (layer 4).

A vertex of weight w turns by w times the jaw's rotation vector, so that cheeks stretch along arcs and not along chords.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from data_recipes.deformers.node_chain import Constants, Values, cross, place_of, spread
from data_recipes.deformers.surface_operators import harmonic, smooth_values

SMOOTHING_PASSES = 14


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class JawMotion:
    """A batch of jaw poses: rotation vector (b, 3) in radians about the pivot, then translation (b, 3) in mm."""

    rotation: Float[Values, "b 3"]
    translation: Float[Values, "b 3"]


def jaw_weights(
    graph: sp.csr_matrix,
    anchors: Int[np.ndarray, " k"],
    values: Float[np.ndarray, " k"],
    keep: Int[np.ndarray, " j"],
    passes: int = SMOOTHING_PASSES,
) -> Float[np.ndarray, " n"]:
    """Return smoothed harmonic weights from 0 to 1.

    graph: the mesh's edges
    anchors, values: vertices and their weights before smoothing
    keep: the vertices that smoothing leaves as they are
    passes: of smoothing
    """
    weight = harmonic(graph, anchors, values)
    keep_mask = np.zeros(len(weight), bool)
    keep_mask[keep] = True
    return np.clip(smooth_values(weight, graph, passes, keep_mask), 0, 1)


def prepare(weight: Float[np.ndarray, " n"], pivot: Float[np.ndarray, " 3"]) -> dict[str, np.ndarray]:
    """Return the jaw's constants for weights (n,) and the pivot in mm."""
    support = np.flatnonzero(weight > 1e-4)
    return {
        "support": support.astype(np.int32),
        "place": place_of(support, len(weight)),
        "weight": weight[support].astype(np.float32),
        "pivot": np.asarray(pivot, np.float32),
    }


def turn(vectors: Float[Values, "b 3 s"], rotation: Float[Values, "b 3 s"]) -> Float[Values, "b 3 s"]:
    """Return v turned by rotation vectors r (Rodrigues): v + sin φ/φ r×v + (1 − cos φ)/φ² r×(r×v), φ = |r|.

    The two quotients are power series in φ², exact to float32 up to one radian and free of 0/0.
    """
    q = (rotation * rotation).sum(axis=-2, keepdims=True)
    sine = 1 - q / 6 * (1 - q / 20 * (1 - q / 42 * (1 - q / 72)))
    versine = 0.5 * (1 - q / 12 * (1 - q / 30 * (1 - q / 56 * (1 - q / 90))))
    once = cross(rotation, vectors)
    return vectors + sine * once + versine * cross(rotation, once)


def open_jaw(constants: Constants, x: Float[Values, "b 3 n"], motion: JawMotion) -> Float[Values, "b 3 n"]:
    """Return positions with the jaw's motion applied, each vertex by its weight."""
    support_x = x[:, :, constants["support"]]
    pivot = constants["pivot"][:, None]
    rotation = motion.rotation[:, :, None] * constants["weight"]
    target_x = turn(support_x - pivot, rotation) + pivot + motion.translation[:, :, None] * constants["weight"]
    return x + spread(target_x - support_x, constants["place"])


def undo_jaw(pivot: Float[Values, " 3"], x: Float[Values, "b 3 s"], motion: JawMotion) -> Float[Values, "b 3 s"]:
    """Return positions in the resting jaw's frame: the inverse of `open_jaw` at weight 1."""
    back = x - motion.translation[:, :, None] - pivot[:, None]
    return turn(back, jnp.broadcast_to(-motion.rotation[:, :, None], back.shape)) + pivot[:, None]


def turn_with_jaw(vectors: Float[Values, "b 3 s"], motion: JawMotion) -> Float[Values, "b 3 s"]:
    """Return directions turned from the resting jaw's frame into the posed one."""
    return turn(vectors, jnp.broadcast_to(motion.rotation[:, :, None], vectors.shape))
