"""Free-form shaping: radial basis functions on the tweak handles (layer 3).

Wendland's C² function interpolates the handles' displacements exactly at the handles; far from all of them nothing
moves. The weights depend on the rest pose only, so the layer is one small matrix.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from data_recipes.deformers.node_chain import Constants, Values, place_of, spread


def wendland(distance: Float[np.ndarray, "*s"], radius: float) -> Float[np.ndarray, "*s"]:
    """Return (1 − r)⁴(4r + 1) for r = distance/radius below 1, else 0: positive definite in space, 1 at 0."""
    r = np.clip(distance / radius, 0, 1)
    return (1 - r) ** 4 * (4 * r + 1)


def weights(
    points: Float[np.ndarray, "n 3"], handles: Float[np.ndarray, "h 3"], radius_mm: float
) -> Float[np.ndarray, "n h"]:
    """Return w (n, h) such that w @ displacements is each handle's displacement at that handle."""
    between = np.linalg.norm(handles[:, None] - handles[None], axis=2)
    to = np.linalg.norm(points[:, None] - handles[None], axis=2)
    return np.linalg.solve(wendland(between, radius_mm), wendland(to, radius_mm).T).T


def prepare(
    neutral: Float[np.ndarray, "n 3"],
    handles: Int[np.ndarray, " h"],
    radius_mm: float,
    mask: Float[np.ndarray, " n"],
    columns: Int[np.ndarray, "h 3"],
    reach_mm: Float[np.ndarray, "h 3"],
) -> dict[str, np.ndarray]:
    """Return the constants.

    neutral: positions, mm
    handles: vertex indices
    radius_mm: how far a handle reaches
    mask: factor on each vertex's motion (0 for teeth)
    columns: the column of p that moves each handle along x, y and z, m for none
    reach_mm: its travel at value 1
    """
    share = weights(neutral, neutral[handles], radius_mm) * mask[:, None]
    support = np.flatnonzero(np.abs(share).max(axis=1) > 1e-5)
    return {
        "share": share[support].T.astype(np.float32),
        "place": place_of(support, len(neutral)),
        "columns": columns.astype(np.int32),
        "reach": reach_mm.astype(np.float32),
    }


def move(constants: Constants, u: Float[Values, "b m"]) -> Float[Values, "b 3 n"]:
    """Return the displacement of every vertex at controls u."""
    padded = jnp.concatenate([u, jnp.zeros_like(u[:, :1])], axis=1)
    travel = padded[:, constants["columns"]] * constants["reach"]  # (b, h, 3)
    displacement = travel.transpose(0, 2, 1) @ constants["share"]  # (b, 3, s)
    return spread(displacement, constants["place"])
