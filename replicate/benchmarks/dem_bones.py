"""Electronic Arts' Dem Bones as a peer of our SSDR: with the best settings for a head, and with its defaults.

Dem Bones is C++ under the BSD licence. Only `make bench-lbs` uses its Python package, `py-dem-bones`, so it is not a
dependency of this suite. Its clusters and its candidates for weights spread along the polygons' edges, so that separate
parts (gums, tongue, teeth) share no bones unless they are linked, by two-vertex polygons between near parts.

Its start splits one cluster into many and ends at the first split that adds none. Where a part of the mesh stays still,
as ICT-FaceKit's neck does, that may be the first split: one cluster's motion fits nearly everything, so that the other
one gets no vertices, and there is a single bone. Then the best settings start from our rigid clusters instead.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.spatial import cKDTree

from replicate.base.exceptions import InputError
from replicate.baselines.skinning.clusters import cluster
from replicate.baselines.skinning.compression import compress
from replicate.baselines.skinning.ssdr import Skin
from replicate.engine.stage import stream_rng
from replicate.geometry.alignment import align

LINKS = 12  # two-vertex polygons between two parts that are linked
INFLUENCES = 8


@dataclass(frozen=True)
class Options:
    """The settings of the solver; None leaves its default.

    link_parts: link separate parts of the mesh by two-vertex polygons. all_bones: start from our clusters where the
    solver's own start finds fewer bones than asked for.
    """

    link_parts: bool = True
    all_bones: bool = True
    trans_affine: float | None = 0.0
    weights_smooth: float | None = 1e-6


BEST = Options()
DEFAULT = Options(link_parts=False, all_bones=False, trans_affine=None, weights_smooth=None)


def solver_class() -> type:
    """Return the solver of `py-dem-bones`. Raises InputError where it isn't installed."""
    try:
        from py_dem_bones._py_dem_bones import DemBones
    except ImportError:
        raise InputError(
            "make bench-lbs compares with Dem Bones, and py-dem-bones is not installed: pip install py-dem-bones"
        ) from None
    return DemBones


def links(neutral: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "t 3"]) -> Int[np.ndarray, "l 2"]:
    """Return pairs of vertices that join a mesh's separate parts into one.

    Parts are joined along the shortest tree between them, each two of them by their `LINKS` nearest pairs of vertices.
    """
    n = len(neutral)
    ends = faces.ravel(), np.roll(faces, 1, axis=1).ravel()
    count, part = connected_components(csr_array((np.ones(len(ends[0])), ends), (n, n)), directed=False)
    members = [np.flatnonzero(part == k) for k in range(count)]
    trees = [cKDTree(neutral[those]) for those in members]
    distance = np.zeros((count, count))
    for a in range(count):
        for b in range(a):
            distance[a, b] = trees[a].query(neutral[members[b]])[0].min() + 1e-9
    pairs = []
    for a, b in zip(*minimum_spanning_tree(csr_array(distance)).nonzero(), strict=True):
        away, other = trees[a].query(neutral[members[b]])
        nearest = np.argsort(away, kind="stable")[:LINKS]
        pairs.append(np.stack([members[b][nearest], members[a][other[nearest]]], 1))
    return np.concatenate(pairs) if pairs else np.zeros((0, 2), int)


def fit(
    neutral: Float[np.ndarray, "n 3"],
    vertices: Float[np.ndarray, "f n 3"],
    faces: Int[np.ndarray, "t 3"],
    bones: int,
    options: Options,
    go_on: Callable[[int, float, float], bool],
) -> tuple[Skin, int]:
    """Fit Dem Bones to poses; return its skin and how many bones its own start finds.

    neutral: rest positions, mm.
    vertices: the poses, mm.
    faces: the mesh's triangles.
    bones: how many.
    options: the solver's settings.
    go_on: (iterations so far, their seconds on the processor, Dem Bones' RMSE in mm) → whether to go on; called after
        the start and after every iteration. The seconds leave out the RMSE, and a start that isn't used.
    """
    # the solver's data and settings
    solver = solver_class()()
    polygons = [face.tolist() for face in faces]
    if options.link_parts:
        polygons += links(neutral, faces).tolist()
    solver.nV, solver.nF, solver.nS, solver.nB = len(neutral), len(vertices), 1, bones
    solver.nnz = min(INFLUENCES, bones)
    solver.fStart, solver.subjectID = np.array([0, len(vertices)], np.int32), np.zeros(len(vertices), np.int32)
    solver.u = np.ascontiguousarray(neutral.T, dtype=np.float64)
    solver.v = np.ascontiguousarray(vertices.transpose(0, 2, 1), dtype=np.float64).reshape(-1, len(neutral))
    solver.fv = polygons
    if options.trans_affine is not None:
        solver.transAffine = options.trans_affine
    if options.weights_smooth is not None:
        solver.weightsSmooth = options.weights_smooth
    # a start, ours where its own finds too few bones
    start = time.process_time()
    solver.init()
    seconds, iteration, own_start = time.process_time() - start, 0, solver.nB
    if options.all_bones and own_start < bones:
        start = time.process_time()
        solver.nB, solver.m = bones, cluster_motions(neutral, vertices, bones)
        solver.init()
        seconds = time.process_time() - start
    # its iterations, timed one by one
    while go_on(iteration, seconds, float(solver.rmse())):
        start = time.process_time()
        solver.computeTranformations()  # so it is spelt there
        solver.computeWeights()
        seconds += time.process_time() - start
        iteration += 1
    return skin_of(neutral, np.asarray(solver.get_weights(), np.float64).T), own_start


def cluster_motions(
    neutral: Float[np.ndarray, "n 3"], vertices: Float[np.ndarray, "f n 3"], bones: int
) -> Float[np.ndarray, "rows columns"]:
    """Return the rigid motions of our clusters in Dem Bones' form: 4 × 4 a pose and bone, for column vectors."""
    labels, _ = cluster(compress(neutral, vertices, stream_rng(0, "lbs", "sketch")), bones)
    blocks = np.zeros((len(vertices), 4, bones, 4))
    blocks[:, 3, :, 3] = 1.0
    for bone in range(bones):
        rotation, translation = align(neutral[labels == bone], vertices[:, labels == bone])
        blocks[:, :3, bone, :3] = rotation.swapaxes(1, 2)
        blocks[:, :3, bone, 3] = translation
    return blocks.reshape(4 * len(vertices), 4 * bones)


def skin_of(neutral: Float[np.ndarray, "n 3"], weights: Float[np.ndarray, "n bones"]) -> Skin:
    """Return the skin of dense weights, with the `INFLUENCES` largest of each vertex."""
    count = min(INFLUENCES, weights.shape[1])
    index = np.argsort(-weights, axis=1, kind="stable")[:, :count].astype(np.int32)
    strongest = np.take_along_axis(weights, index, 1)
    strongest = (strongest / strongest.sum(1, keepdims=True)).astype(np.float32)
    return Skin(np.asarray(neutral, np.float32), index, strongest, weights.shape[1])
