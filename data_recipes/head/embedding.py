"""Planar embeddings without flips: Tutte's, with weights chosen so that the vertices lie evenly."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

WEIGHT_RANGE = 1e5  # between the strongest and the weakest edge; keeps the system well conditioned
CORNERS = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
DIRECTIONS = np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])


def square_embedding(
    count: int,
    edges: Int[np.ndarray, "e 2"],
    length: Float[np.ndarray, " e"],
    sides: list[Int[np.ndarray, " _"]],
    rounds: int,
) -> Float[np.ndarray, "n 2"]:
    """Lay a disc out in the unit square, each vertex at the weighted mean of its neighbours [Tutte 1963].

    The border is spaced by the target lengths of its edges. For any positive weights no triangle flips, if none has all
    its corners on one side [Floater 1997]. So the weights are free to be chosen: every round strengthens the edges that
    came out too long and weakens the others. A few rounds are best: many make some edges very short to please others.
    The graph must be 3-connected, as our parts without holes are; holes have to be bridged by edges of their own.

    Args:
        count: n, how many vertices. edges: pairs of them. length: target relative length of each.
        sides: the lower, right, upper and left side's vertices in order, each from its first corner up to the last one
            before the next corner.
    """
    edges, weight = np.asarray(edges), 1.0 / np.asarray(length, float)
    target_length = {frozenset(edge): share for edge, share in zip(edges.tolist(), length.tolist(), strict=True)}
    xy = np.zeros((count, 2))
    for side, after, corner, along in zip(sides, sides[1:] + sides[:1], CORNERS, DIRECTIONS, strict=True):
        line = np.append(side, after[0]).tolist()
        share = np.cumsum([0.0] + [target_length[frozenset(edge)] for edge in pairwise(line)])
        xy[side] = corner + share[:-1, None] / share[-1] * along
    border = np.concatenate(sides)
    free = np.setdiff1d(np.arange(count), border)
    inner = ~np.isin(edges, border).all(1)
    for i in range(rounds + 1):
        xy[free] = _solve(edges, weight, free, xy)
        if i < rounds:
            weight = weight * np.sqrt(np.linalg.norm(xy[edges[:, 0]] - xy[edges[:, 1]], axis=1) / length)
            weight = np.clip(weight / np.exp(np.log(weight[inner]).mean()), WEIGHT_RANGE**-0.5, WEIGHT_RANGE**0.5)
    return xy


def _solve(edges: np.ndarray, weight: np.ndarray, free: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """Return the free vertices' positions at the weighted means of their neighbours."""
    (a, b), n = edges.T, len(xy)
    row, column = np.concatenate([a, b, a, b]), np.concatenate([b, a, a, b])
    laplacian = csc_matrix((np.concatenate([-weight, -weight, weight, weight]), (row, column)), (n, n))
    matrix = laplacian.tocsr()[free].tocsc()
    border = np.setdiff1d(np.arange(n), free)
    options = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    return splu(matrix[:, free], **options).solve(-(matrix[:, border] @ xy[border]))
