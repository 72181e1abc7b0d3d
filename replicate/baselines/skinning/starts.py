"""The start of SSDR, a first skin from clusters of vertices, and the course of a fit: relaxed first, then sparse."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from replicate.baselines.skinning.alternation import Problem, State, dense, normal_equations, sparse, step
from replicate.baselines.skinning.bones import sweep, weighted_points
from replicate.baselines.skinning.clusters import cluster, split
from replicate.baselines.skinning.compression import CompressedPoses, diffuse, edge_metric

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
    """Return the state with more bones, each on a part of a worst-fitted region, the vertices with one strongest bone.

    A new bone starts with the motion of that strongest one.
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
    """Return the state of some weights (n, bones), with bones fitted to them from motions (f, 3, bones, 4)."""
    index, weights = sparse(loads, influences)
    motion = sweep(motion, *normal_equations(problem, index, weights, motion.shape[2]), SWEEPS)
    return State(0, motion, motion, index, weights, np.inf, 0.0)


def vertex_errors(data: CompressedPoses, motion: np.ndarray, loads: np.ndarray) -> np.ndarray:
    """Return every vertex's squared error (n,), summed over poses."""
    flat = motion.reshape(3 * data.frames, -1)
    spread = weighted_points(data.points, loads)
    moved = ((spread @ (flat.T @ flat)) * spread).sum(1)
    together = ((spread @ (flat.T @ data.basis)) * data.coefficients.T).sum(1)
    return np.maximum(moved - 2 * together + (data.coefficients**2).sum(0), 0.0)


# The course of an SSDR fit: at first all bones may act on every vertex, then only the few that a skin may hold.

RELAXED_INFLUENCES = 4  # times the influences that a skin may hold: with up to 32 bones, all of them
STIFFER = 5.0  # times the coherence, meanwhile
SMOOTHING = 2.0  # diffusion time, in squared edges, of the weights that decide which bones are kept


@dataclass(frozen=True)
class Alternation:
    """The course of a fit.

    stiff, plain: the problem of relaxed iterations, and that of the others. influences: bones a vertex at the end.
    relaxed: iterations, before the others, in which all bones may act.
    """

    stiff: Problem
    plain: Problem
    influences: int
    relaxed: int

    def start(self, bones: int) -> State:
        """Return the state before the first iteration."""
        if self.relaxed:
            return start(self.stiff, bones, RELAXED_INFLUENCES * self.influences)
        return start(self.plain, bones, self.influences)

    def step(self, state: State) -> State:
        """Return the state one iteration on."""
        if state.iteration >= self.relaxed:
            return step(self.plain, state)
        state = step(self.stiff, state)
        return sparsify(self.plain, state, self.influences) if state.iteration == self.relaxed else state


def alternation(
    data: CompressedPoses, faces: Int[np.ndarray, "t 3"], coherence: float, influences: int, relaxed: int
) -> Alternation:
    """Return the course of a fit to the poses of a mesh.

    data: the poses.
    faces: the mesh's triangles.
    coherence: how much the change of errors along edges weighs against distance.
    influences: bones a vertex at the end.
    relaxed: iterations, before the others, in which all bones may act.
    """
    rest = data.points[:, :3]
    stiff, plain = (Problem(data, edge_metric(rest, faces, c)) for c in (STIFFER * coherence, coherence))
    return Alternation(stiff, plain, influences, relaxed)


def sparsify(problem: Problem, state: State, influences: int) -> State:
    """Return the state with at most `influences` bones a vertex, those that it and its neighbours use most."""
    loads = dense(state.bone_index, state.weights, state.motion.shape[2])
    smoothed = diffuse(problem.metric.edges, loads, SMOOTHING)
    index, _ = sparse(smoothed, influences)
    places = np.arange(len(index))[:, None]
    weights: Float[np.ndarray, "n k"] = loads[places, index] + 1e-6 * smoothed[places, index]
    weights[:, smoothed.shape[1] :] = 0.0  # unused places
    weights /= weights.sum(1, keepdims=True)
    return replace(state, bone_index=index, weights=weights, before=state.motion, energy=np.inf, beta=0.0)
