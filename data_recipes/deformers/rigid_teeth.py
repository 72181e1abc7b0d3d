"""Teeth: each takes one rigid transformation, that of the jaw and the rigid part of the head's shape (layer 10)."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from data_recipes.deformers.jaw import JawMotion, turn
from data_recipes.deformers.node_chain import Constants, Values, place_of, spread

PROBE_MM = 2.0
POLAR_STEPS = 6


def tooth_vertices(
    neutral: Float[np.ndarray, "n 3"], teeth: list[Int[np.ndarray, " s"]]
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"], Float[np.ndarray, "teeth 3"], Float[np.ndarray, "k 3"]]:
    """Return the vertices of all teeth, the tooth of each, the teeth's centres, and the vertices relative to these."""
    support = np.concatenate(teeth) if teeth else np.zeros(0, int)
    owner = np.repeat(np.arange(len(teeth)), [len(tooth) for tooth in teeth]).astype(np.int32)
    centre = np.stack([neutral[tooth].mean(axis=0) for tooth in teeth]) if teeth else np.zeros((0, 3))
    return support, owner, centre, neutral[support] - centre[owner]


def prepare(
    neutral: Float[np.ndarray, "n 3"], teeth: list[Int[np.ndarray, " s"]], lower: list[bool], pivot: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the constants for teeth given as lists of vertices; `lower` says which belong to the jaw."""
    support, owner, centre, local = tooth_vertices(neutral, teeth)
    return {
        "place": place_of(support, len(neutral)),
        "owner": owner,
        "centre": centre.T.astype(np.float32),
        "local": local.T.astype(np.float32),
        "lower": np.asarray(lower, np.float32),
        "pivot": np.asarray(pivot, np.float32),
    }


def polar_rotation(matrix: Float[Values, "*b 3 3"]) -> Float[Values, "*b 3 3"]:
    """Return the rotation nearest to a matrix of positive determinant: Newton's iteration R ← ½(R + R⁻ᵀ)."""

    def step(_, r):
        cofactor = jnp.cross(jnp.roll(r, -1, axis=-2), jnp.roll(r, -2, axis=-2))
        determinant = (r[..., 0, :] * cofactor[..., 0, :]).sum(axis=-1)[..., None, None]
        return 0.5 * (r + cofactor / determinant)

    return jax.lax.fori_loop(0, POLAR_STEPS, step, matrix)


def place_teeth(
    constants: Constants,
    x: Float[Values, "b 3 n"],
    motion: JawMotion,
    warp: Callable[[Float[Values, "b 3 s"]], Float[Values, "b 3 s"]],
) -> Float[Values, "b 3 n"]:
    """Return positions in which every tooth's vertices are a rigid image of the resting tooth.

    warp: the head's map of space; it takes the centre of a tooth along, and turns the tooth by its rotation there.
    """
    count = constants["centre"].shape[1]
    if count == 0:
        return x
    batch = len(x)
    lower = constants["lower"]
    pivot = constants["pivot"][:, None]
    rotation = motion.rotation[:, :, None] * lower
    centre = jnp.broadcast_to(constants["centre"], (batch, 3, count))
    centre = turn(centre - pivot, rotation) + pivot + motion.translation[:, :, None] * lower
    probes = [centre] + [centre + sign * PROBE_MM * jnp.eye(3)[i][:, None] for i in range(3) for sign in (1.0, -1.0)]
    images = warp(jnp.concatenate(probes, axis=2)).reshape(batch, 3, 7, count)
    columns = [(images[:, :, 1 + 2 * i] - images[:, :, 2 + 2 * i]) / (2 * PROBE_MM) for i in range(3)]
    spin = polar_rotation(jnp.stack(columns, axis=-1).transpose(0, 2, 1, 3))  # (b, tooth, row, column)

    owner = constants["owner"]
    local = turn(jnp.broadcast_to(constants["local"], (batch, *constants["local"].shape)), rotation[:, :, owner])
    offset = jnp.einsum("bsij,bjs->bis", spin[:, owner], local)
    inside = constants["place"] < len(owner)
    return jnp.where(inside, spread(offset + images[:, :, 0][:, :, owner], constants["place"]), x)
