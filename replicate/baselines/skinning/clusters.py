"""The start of SSDR: clusters of vertices that move rigidly, by splitting and reassigning (LBG).

Clusters follow motion and not mesh edges, so that parts which share no edge (teeth, gums, lids) may share a bone.
"""

import numpy as np
from jaxtyping import Float, Int

from replicate.baselines.skinning.bones import sweep, weighted_points
from replicate.baselines.skinning.compression import CompressedPoses
from replicate.baselines.skinning.weights import gram_table, monomials

FEWEST = 6  # with fewer vertices a cluster does not determine its motion
LLOYD = 4  # reassignments after each split
FINAL = 10  # reassignments once all clusters exist


def cluster(data: CompressedPoses, bones: int) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "f 3 bones 4"]]:
    """Return every vertex's cluster and the clusters' rigid motions.

    The clusters with the largest errors are split, at most doubling their number, at the vertex that fits its cluster
    badly and lies far from its centre; then vertices move to the cluster whose motion suits them best.
    """
    n = len(data.points)
    labels = np.zeros(n, np.int64)
    motion = fit_clusters(data, labels, 1)
    while True:
        count = motion.shape[2]
        error = np.take_along_axis(cluster_errors(data, motion), labels[:, None], 1)[:, 0]
        if count == bones:
            return labels, motion
        for _ in range(min(count, bones - count)):
            labels, error = split(data.points[:, :3], labels, error)
        new_count = int(labels.max()) + 1
        motion = fit_clusters(data, labels, new_count)
        for _ in range(FINAL if new_count == bones else LLOYD):
            errors = cluster_errors(data, motion)
            labels = refill(data.points[:, :3], np.argmin(errors, 1), errors, new_count)
            motion = fit_clusters(data, labels, new_count)


def split(
    rest: Float[np.ndarray, "n 3"], labels: Int[np.ndarray, "n"], error: Float[np.ndarray, "n"]
) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Split the cluster of the largest total error; its parts' errors become zero, so that another cluster is next.

    Where no cluster has an error, the one with the most vertices is split.
    """
    sizes = np.bincount(labels)
    worst = int(np.argmax(np.where(sizes > 1, np.bincount(labels, error), -1.0)))
    if error[labels == worst].sum() <= 0 or sizes[worst] < 2:
        worst = int(np.argmax(sizes))
    members = np.flatnonzero(labels == worst)
    centre = rest[members].mean(0)
    away = ((rest[members] - centre) ** 2).sum(1)
    blame = away * error[members]
    seed = rest[members[np.argmax(blame if blame.max() > 0 else away)]]
    nearer = ((rest[members] - seed) ** 2).sum(1) < away
    if not nearer.any() or nearer.all():  # all in one place: any halves will do
        nearer = np.arange(len(members)) < max(len(members) // 2, 1)
    labels, error = labels.copy(), error.copy()
    labels[members[nearer]] = labels.max() + 1
    error[members] = 0.0
    return labels, error


def refill(
    rest: Float[np.ndarray, "n 3"], labels: Int[np.ndarray, "n"], errors: Float[np.ndarray, "n bones"], count: int
) -> Int[np.ndarray, "n"]:
    """Give every cluster that holds too few vertices those around the worst-fitted vertex of the others."""
    fewest = min(FEWEST, max(len(rest) // (2 * count), 1))
    labels = labels.copy()
    error = np.take_along_axis(errors, labels[:, None], 1)[:, 0].copy()
    for small in range(count):
        sizes = np.bincount(labels, minlength=count)
        if sizes[small] >= fewest:
            continue
        free = np.flatnonzero((sizes[labels] >= 2 * fewest) & (labels != small))
        if not len(free):
            free = np.flatnonzero((sizes[labels] > fewest) & (labels != small))
        seed = free[np.argmax(error[free])]
        mates = np.flatnonzero(labels == labels[seed])
        room = min(fewest, sizes[labels[seed]] - fewest)
        nearest = mates[np.argsort(((rest[mates] - rest[seed]) ** 2).sum(1), kind="stable")[:room]]
        labels[nearest] = small
        error[nearest] = 0.0
    return labels


def cluster_errors(data: CompressedPoses, motion: Float[np.ndarray, "f 3 bones 4"]) -> Float[np.ndarray, "n bones"]:
    """Return each vertex's squared error, summed over poses, under each bone's motion alone."""
    flat = motion.reshape(3 * data.frames, -1)
    bones = motion.shape[2]
    table = gram_table(flat.T @ flat)
    moved = monomials(data.points) @ table[:, np.arange(bones), np.arange(bones)]
    projection = ((flat.T @ data.basis) @ data.coefficients).reshape(bones, 4, -1)
    together = np.einsum("bpn,np->nb", projection, data.points)
    return np.maximum(moved - 2 * together + (data.coefficients**2).sum(0)[:, None], 0.0)


def fit_clusters(data: CompressedPoses, labels: Int[np.ndarray, "n"], count: int) -> Float[np.ndarray, "f 3 bones 4"]:
    """Return the rigid motion of every cluster in every pose (Eq. 3 for each)."""
    weights = (labels[:, None] == np.arange(count)).astype(np.float64)
    z = weighted_points(data.points, weights)
    vu = (data.basis @ (data.coefficients @ z)).reshape(data.frames, 3, -1)
    still = np.zeros((data.frames, 3, count, 4))
    return sweep(still, z.T @ z, vu, 1)
