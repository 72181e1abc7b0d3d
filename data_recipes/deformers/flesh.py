"""Flesh: delta mush, which evens out a deformation and keeps the resting detail (layer 7).

The posed skin is smoothed, and the detail that smoothing took from the *resting* skin is put back in the frames of
the smoothed pose. So unevenness of the layers before is gone, and the detail of the neutral is not. Inside, positions
are rows of one vertex each (see `node_chain.rows_at`).
"""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Float, Int

from data_recipes.deformers.node_chain import Constants, Values, add_rows, pick, place_of, rows_at
from data_recipes.deformers.surface_operators import padded_neighbours, vertex_normals

PASSES = 6
WIDTH = 6  # neighbours used per vertex

# x, y and z of s vectors in b poses, (s, b) each: the compiler computes them in one go.
Vectors = Sequence[Array]


def _fans(
    vertices: np.ndarray, normals: np.ndarray, neighbours: np.ndarray, weight: np.ndarray
) -> Float[np.ndarray, "2 w s"]:
    """Return weights cos θ and sin θ of each vertex's neighbours; θ is the arm's angle from upwards about the normal.

    Weighted sums of the neighbours are then an upward and a sideward tangent, alike on both sides of the face.
    """
    up = np.where(np.abs(normals[:, 1:2]) > 0.9, np.array([[0.0, 0, 1]]), np.array([[0.0, 1, 0]]))
    up = up - normals * (up * normals).sum(axis=1, keepdims=True)
    side = np.cross(normals, up)
    arms = vertices[neighbours] - vertices[:, None]
    angle = np.arctan2((arms * side[:, None]).sum(axis=2), (arms * up[:, None]).sum(axis=2))
    used = weight > 0
    fans = np.stack([np.cos(angle) * used, np.sin(angle) * used])
    # Without the mean the sums would move with the vertex itself.
    return ((fans - fans.sum(axis=2, keepdims=True) * weight) * used).transpose(0, 2, 1)


def smooth(constants: Constants, rows: Float[Values, "s c"]) -> Float[Array, "s c"]:
    """Return rows after PASSES of moving half-way to the mean of the neighbours; the border stays."""
    index, weight = constants["neighbour"], jnp.asarray(constants["neighbour_weight"])[:, :, None]
    pull = jnp.asarray(constants["pull"])[:, None]

    # The loop keeps the compiler from fusing passes and computing each neighbour's neighbours again and again.
    def once(_, y):
        mean = sum(pick(y, index[k]) * weight[k] for k in range(index.shape[0]))
        return y + pull * (mean - y)

    return jax.lax.fori_loop(0, PASSES, once, jnp.asarray(rows))


def frames(constants: Constants, smoothed: Float[Array, "s c"]) -> tuple[Vectors, Vectors, Vectors]:
    """Return the orthonormal frames (upward tangent, sideward tangent, normal) of a smoothed skin.

    smoothed: a row per vertex, of every pose's x, then y, then z.
    """
    index, (upward, sideward) = jnp.asarray(constants["neighbour"]), jnp.asarray(constants["fans"])

    def add(k, sums):
        arm = pick(smoothed, index[k])
        return sums[0] + arm * upward[k][:, None], sums[1] + arm * sideward[k][:, None]

    # Without the loop the compiler would compute both sums anew for each of the nine components below.
    sums = jax.lax.fori_loop(0, index.shape[0], add, (jnp.zeros_like(smoothed), jnp.zeros_like(smoothed)))
    up, side = (jnp.split(total, 3, axis=1) for total in sums)
    first, normal = _unit(up), _unit(_cross(up, side))
    return first, _cross(normal, first), normal


def _cross(a: Vectors, b: Vectors) -> Vectors:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _unit(a: Vectors) -> Vectors:
    length = jnp.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2] + 1e-12)
    return a[0] / length, a[1] / length, a[2] / length


def prepare(
    neutral: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "f 3"],
    graph: sp.csr_matrix,
    weight: Float[np.ndarray, " n"],
) -> dict[str, np.ndarray]:
    """Return the constants for the skin where `weight` is above 0; at 1, mush replaces the input in full."""
    # A corner of the mesh has too few neighbours for a frame.
    inside = (weight > 1e-3) & (np.asarray(graph.sum(axis=1)).ravel() >= 3)
    support = np.flatnonzero(inside | ((graph @ inside) > 0))
    x = neutral[support]
    index, share = padded_neighbours(graph[support][:, support].tocsr(), WIDTH)
    constants = {
        "support": support.astype(np.int32),
        "place": place_of(support, len(neutral)),
        "neighbour": np.ascontiguousarray(index.T),
        "neighbour_weight": np.ascontiguousarray(share.T),
        "pull": (0.5 * inside[support]).astype(np.float32),
        "weight": np.where(inside, weight, 0)[support].astype(np.float32),
        "fans": _fans(x, vertex_normals(neutral, faces)[support], index, share).astype(np.float32),
    }
    rest = jnp.asarray(x, jnp.float32)
    smoothed = smooth(constants, rest)
    lost = jnp.split(rest - smoothed, 3, axis=1)
    detail = [sum(a * b for a, b in zip(lost, axis, strict=True))[:, 0] for axis in frames(constants, smoothed)]
    return constants | {"detail": np.stack(detail)}


def mush(constants: Constants, x: Float[Values, "b 3 n"]) -> Float[Values, "b 3 n"]:
    """Return positions after the delta mush."""
    rows = rows_at(x, constants["support"])
    flat = rows.reshape(len(rows), -1)
    smoothed = smooth(constants, flat)
    detail = jnp.asarray(constants["detail"])[:, :, None]
    offset = [sum(axis[i] * detail[k] for k, axis in enumerate(frames(constants, smoothed))) for i in range(3)]
    moved = jnp.asarray(constants["weight"])[:, None] * (smoothed + jnp.concatenate(offset, axis=1) - flat)
    return add_rows(x, moved.reshape(rows.shape), constants["place"])
