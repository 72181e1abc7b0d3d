"""Where SSDR starts: half of the bones from rigid clusters, the others where blending those leaves most error.

Two things decide which minimum the alternation ends in. From hard borders between clusters the sparse supports grow as
the noise has it, each vertex on its own; from borders blended along the mesh, neighbours start with the same bones and
end with smaller errors, most of all in their normals. And rigid clusters spend bones on skin that a blend of two
others would carry, while a tooth goes without; after a few iterations the residual shows who is in need.
"""

from dataclasses import replace

import numpy as np

from replicate.approximation.skinning.alternation import Problem, State, dense, normal_equations, sparse, step
from replicate.approximation.skinning.bones import sweep, weighted_points
from replicate.approximation.skinning.clusters import cluster, split
from replicate.approximation.skinning.compression import CompressedPoses
from replicate.approximation.skinning.edge_metric import diffuse

CLUSTER_SHARE = 0.5  # of the bones come from rigid clusters
GROWTH = 0.25  # of the bones so far are added at a time
ITERATIONS = 2  # between two additions
CLUSTER_BLEND, ADDED_BLEND = 30.0, 5.0  # diffusion times, in squared edges, of the borders
SWEEPS = 10  # over the bones, once borders are blended


def start(problem: Problem, bones: int, influences: int) -> State:
    """Return the state before the first iteration, with all the bones."""
    labels, motion = cluster(problem.data, max(int(bones * CLUSTER_SHARE), 1))
    blend = diffuse(problem.metric.edges, np.eye(motion.shape[2])[labels], CLUSTER_BLEND)
    state = settle(problem, motion, np.where(blend > 1e-3, blend, 0.0), influences)
    while (count := state.motion.shape[2]) < bones:
        for _ in range(ITERATIONS):
            state = step(problem, state)
        state = grow(problem, state, min(bones - count, max(int(count * GROWTH), 1)))
    return replace(state, iteration=0)


def grow(problem: Problem, state: State, more: int) -> State:
    """Return the state with more bones, each on a part that the worst-fitted regions are split into.

    A region is the vertices of one strongest bone; its part starts with that bone's motion.
    """
    index, weights, motion = state.bone_index, state.weights, state.motion
    loads = dense(index, weights, motion.shape[2])
    strongest = np.argmax(loads, axis=1)
    labels = np.unique(strongest, return_inverse=True)[1]
    first = int(labels.max()) + 1
    error = vertex_errors(problem.data, motion, loads)
    for _ in range(more):
        labels, error = split(problem.data.points[:, :3], labels, error)
    parts = labels[:, None] == np.arange(first, first + more)
    share = diffuse(problem.metric.edges, parts.astype(np.float64), ADDED_BLEND)
    share = np.where(share > 0.02, share, 0.0)
    loads = np.hstack([loads * np.maximum(1.0 - share.sum(1, keepdims=True), 0.0), share])
    parents = [strongest[np.argmax(part)] for part in parts.T]
    return settle(problem, np.concatenate([motion, motion[:, :, parents]], axis=2), loads, weights.shape[1])


def settle(problem: Problem, motion: np.ndarray, loads: np.ndarray, influences: int) -> State:
    """Return the state of some weights (n, bones), its bones fitted to them from some motions (f, 3, bones, 4)."""
    index, weights = sparse(loads, influences)
    motion = sweep(motion, *normal_equations(problem, index, weights, motion.shape[2]), SWEEPS)
    return State(0, motion, motion, index, weights, np.inf, 0.0)


def vertex_errors(data: CompressedPoses, motion: np.ndarray, loads: np.ndarray) -> np.ndarray:
    """Return every vertex's squared error (n,), summed over poses."""
    flat = motion.reshape(3 * data.frames, -1)
    spread = weighted_points(data.points, loads)
    own = ((spread @ (flat.T @ flat)) * spread).sum(1)
    together = ((spread @ (flat.T @ data.basis)) * data.coefficients.T).sum(1)
    return np.maximum(own - 2 * together + (data.coefficients**2).sum(0), 0.0)
