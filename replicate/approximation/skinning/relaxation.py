"""The course of an SSDR fit: at first all bones may act on every vertex, then only the few that a skin may hold.

Which bones a vertex may have is a choice among millions, and the alternation cannot take it back: a bone without weight
learns nothing of the vertex. So the choice comes last. While all bones may act, the weights are the solution of a
convex problem and neighbours' weights are alike; a stiffer metric makes them more so. Then each vertex keeps the bones
whose weights, smoothed along the mesh, are largest there, so that neighbours keep the same ones.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from replicate.approximation.skinning.alternation import Problem, State, dense, sparse, step
from replicate.approximation.skinning.compression import CompressedPoses
from replicate.approximation.skinning.edge_metric import diffuse, edge_metric
from replicate.approximation.skinning.first_skin import start

RELAXED_INFLUENCES = 4  # times the influences that a skin may hold: with up to 32 bones, all of them
STIFFER = 5.0  # times the coherence, meanwhile
SMOOTHING = 2.0  # diffusion time, in squared edges, of the weights that decide which bones are kept


@dataclass(frozen=True)
class Alternation:
    """A fit from its start to its end. relaxed: iterations, before the others, in which all bones may act."""

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
    """Return how poses of a mesh are fitted."""
    rest = data.points[:, :3]
    stiff, plain = (Problem(data, edge_metric(rest, faces, c)) for c in (STIFFER * coherence, coherence))
    return Alternation(stiff, plain, influences, relaxed)


def sparsify(problem: Problem, state: State, influences: int) -> State:
    """Return the state with at most `influences` bones a vertex: those that its surroundings use most."""
    loads = dense(state.bone_index, state.weights, state.motion.shape[2])
    smoothed = diffuse(problem.metric.edges, loads, SMOOTHING)
    index, _ = sparse(smoothed, influences)
    places = np.arange(len(index))[:, None]
    weights: Float[np.ndarray, "n k"] = loads[places, index] + 1e-6 * smoothed[places, index]
    weights[:, smoothed.shape[1] :] = 0.0  # unused places
    weights /= weights.sum(1, keepdims=True)
    return replace(state, bone_index=index, weights=weights, before=state.motion, energy=np.inf, beta=0.0)
