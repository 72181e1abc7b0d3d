"""Regional bases: each region of the mesh moves in the span of its own principal components, in the metric of the loss.

Eq. 1 weighs positions and face normals. For small offsets a normal turns by the differences of offsets along a face's
edges over their lengths, so the metric of a region is ‖x‖² = Σ_v |x_v|² / n + (α² / f) Σ_edges |x_i − x_j|² / |e_ij|²,
a sparse quadratic form Q. Components that are principal in it capture what the loss sees.

Where regions meet, their errors differ, which would turn the normals of the faces between them. So regions overlap by
a few rings of vertices, in which one fades into the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int

if TYPE_CHECKING:  # posing a face doesn't need it, and it is slow to load
    from scipy.sparse import csr_matrix

SHORTEST_MM = 0.5  # an edge's length in the metric is at least this


@dataclass(frozen=True)
class RegionalBasis:
    """One region's basis.

    vertices: (k,) indices into the mesh. mean: (k, 3) mm. components: (c, k, 3) mm, each of length 1 in the metric.
    """

    vertices: Int[np.ndarray, " k"]
    mean: Float32[np.ndarray, "k 3"]
    components: Float32[np.ndarray, "c k 3"]


def split_regions(points: Float[np.ndarray, "n 3"], count: int) -> list[Int[np.ndarray, " k"]]:
    """Return `count` compact sets of points, by halving the largest across its longest side again and again."""
    regions = [np.arange(len(points))]
    while len(regions) < min(count, len(points)):
        largest = regions.pop(int(np.argmax([len(region) for region in regions])))
        side = np.ptp(points[largest], axis=0).argmax()
        order = largest[np.argsort(points[largest, side], kind="stable")]
        regions += [np.sort(order[: len(order) // 2]), np.sort(order[len(order) // 2 :])]
    return regions


def blend_weights(
    regions: Sequence[Int[np.ndarray, " _"]], faces: Int[np.ndarray, "f 3"], count: int, rings: int
) -> list[tuple[Int[np.ndarray, " _"], Float64[np.ndarray, " _"]]]:
    """Return for each region the vertices that it moves and its weights there; a vertex's weights sum to 1.

    A region's vertices come first and in their order; those of other regions follow.

    regions: vertices, each in one region. count: how many vertices the mesh has. rings: a weight fades from 1 inside a
    region to 0 outside over so many rings of edges on either side of the border; with 0, all weights are 1.
    """
    owner = np.full(count, -1)
    for k, region in enumerate(regions):
        owner[region] = k
    near = _neighbours(faces[(owner[faces] >= 0).all(axis=1)], count)
    shares = np.zeros((len(regions), count))
    for k in range(len(regions)):
        inside = owner == k
        depth = _distances(near, (owner >= 0) & ~inside, rings) - _distances(near, inside, rings)
        middle = depth - 0.5 * np.sign(depth)  # of the border's edges, from which rings are counted
        shares[k] = (0.5 + middle / (2 * rings)).clip(0, 1) if rings else inside
        shares[k, owner < 0] = 0
    shares /= np.maximum(shares.sum(axis=0), 1e-9)
    members = [
        np.concatenate([region, np.flatnonzero((shares[k] > 0) & (owner != k))]) for k, region in enumerate(regions)
    ]
    return [(vertices, shares[k, vertices]) for k, vertices in enumerate(members)]


def _neighbours(faces: Int[np.ndarray, "f 3"], count: int) -> csr_matrix:
    """Return which vertices share an edge, (n, n)."""
    from scipy.sparse import csr_matrix

    rows, columns = faces[:, [0, 1, 1, 2, 2, 0]].ravel(), faces[:, [1, 0, 2, 1, 0, 2]].ravel()
    return csr_matrix((np.ones(len(rows), bool), (rows, columns)), shape=(count, count))


def _distances(near: csr_matrix, start: Bool[np.ndarray, " n"], most: int) -> Int[np.ndarray, " n"]:
    """Return how many edges lie between each vertex and the nearest of `start`, at most `most` + 1."""
    reached, distances = start.copy(), np.where(start, 0, most + 1)
    for ring in range(1, most + 1):
        further = (near @ reached) & ~reached
        distances[further] = ring
        reached |= further
    return distances


def loss_metric(
    neutral: Float[np.ndarray, "k 3"],
    faces: Int[np.ndarray, "g 3"],
    vertex_count: int,
    face_count: int,
    normal_weight: float,
) -> csr_matrix:
    """Return Q (k, k), the metric of one coordinate of a region's offsets.

    neutral: the region's vertices, mm.
    faces: those within the region, of its vertices' indices.
    vertex_count: n of Eq. 1, of the whole mesh.
    face_count: f of Eq. 1, of the whole mesh.
    normal_weight: α of Eq. 1.
    """
    from scipy.sparse import csr_matrix, identity

    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    length = np.maximum(np.linalg.norm(neutral[pairs[:, 0]] - neutral[pairs[:, 1]], axis=1), SHORTEST_MM)
    rows = np.tile(np.arange(len(pairs)), 2)
    differences = csr_matrix(
        (np.concatenate([1 / length, -1 / length]), (rows, pairs.T.ravel())), shape=(len(pairs), len(neutral))
    )
    positions = identity(len(neutral)) / max(vertex_count, 1)
    return (positions + normal_weight**2 / max(face_count, 1) * (differences.T @ differences)).tocsr()


def principal_basis(
    vertices: Int[np.ndarray, " k"],
    offsets: Float[np.ndarray, "s k 3"],
    metric: csr_matrix,
    components: int,
    through_rest: bool = False,
) -> RegionalBasis:
    """Return a region's basis: its offsets' mean over some samples, and their principal components in the metric.

    vertices: of the region.
    offsets: in the samples, mm.
    metric: as `loss_metric` gives it.
    components: how many at most.
    through_rest: whether the mean is left at zero, so that the pose at rest has the coefficients zero.
    """
    from scipy.linalg import eigh  # only training needs it

    mean = np.zeros_like(offsets[0]) if through_rest else offsets.mean(axis=0)
    centred = (offsets - mean).astype(np.float64)  # in half the digits the last components would be rounding errors
    weighed = apply_metric(metric, centred)
    s = len(offsets)
    gram = centred.reshape(s, -1) @ weighed.reshape(s, -1).T
    count = max(1, min(components, s - 1 + through_rest, centred[0].size))
    values, vectors = eigh(0.5 * (gram + gram.T), subset_by_index=[s - count, s - 1])
    values, vectors = values[::-1], vectors[:, ::-1]
    kept = values > 1e-10 * max(values[0], 1e-30)
    kept[0] = True  # a region that never moves has one component, of zeros
    shapes = np.tensordot(vectors[:, kept].T, centred, 1)
    lengths = np.sqrt(np.maximum(values[kept], 1e-30))
    return RegionalBasis(vertices, mean.astype(np.float32), (shapes / lengths[:, None, None]).astype(np.float32))


def apply_metric(metric: csr_matrix, offsets: Float[np.ndarray, "s k 3"]) -> Float[np.ndarray, "s k 3"]:
    """Return Q x of each coordinate of each x."""
    s, k, _ = offsets.shape
    flat = metric @ offsets.transpose(1, 0, 2).reshape(k, -1)
    return flat.reshape(k, s, 3).transpose(1, 0, 2).astype(offsets.dtype)


def projection(basis: RegionalBasis, metric: csr_matrix) -> Float64[np.ndarray, "d c"]:
    """Return P (3k, c), by which (x − mean) P are the coefficients of the offsets nearest to x in the metric."""
    weighed = apply_metric(metric, basis.components.astype(np.float64)).reshape(len(basis.components), -1)
    flat = basis.components.reshape(len(basis.components), -1).astype(np.float64)
    return np.linalg.lstsq(flat @ weighed.T, weighed)[0].T
