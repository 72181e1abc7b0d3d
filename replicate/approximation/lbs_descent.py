"""The alternation of SSDR: its state, one iteration, and bones that nobody uses."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from replicate.approximation.lbs_bones import project, sweep, weighted_points
from replicate.approximation.lbs_clusters import FEWEST, cluster
from replicate.approximation.lbs_compression import Compressed
from replicate.approximation.lbs_weights import ROUNDS, gram_table, monomials, solve_weights

SWEEPS = 3  # Gauss–Seidel sweeps over the bones in each iteration
BETA_STEP, BETA_MOST = 0.1, 0.9  # of the extrapolation
FIRST_ROUNDS = 24  # additions a vertex in the first iteration, which starts from one bone
UNUSED = 1e-2  # Σ w² of a bone below which it carries nothing


@dataclass(frozen=True)
class State:
    """Where a fit stands after some iterations; everything that the next one depends on.

    motion, before: (f, 3, bones, 4), the last two bone steps. bone_index (n, k) int64, weights (n, k) float64. energy:
    summed squared error in units of the rest radius. beta: how far the next iteration extrapolates.
    """

    iteration: int
    motion: Float[np.ndarray, "f 3 bones 4"]
    before: Float[np.ndarray, "f 3 bones 4"]
    bone_index: Int[np.ndarray, "n k"]
    weights: Float[np.ndarray, "n k"]
    energy: float
    beta: float


def start(data: Compressed, bones: int, influences: int) -> State:
    """Return the state before the first iteration: every vertex on the one bone of its cluster."""
    labels, motion = cluster(data, bones)
    index = np.zeros((len(labels), influences), np.int64)
    weights = np.zeros((len(labels), influences))
    index[:, 0], weights[:, 0] = labels, 1.0
    return State(0, motion, motion, index, weights, np.inf, 0.0)


def step(data: Compressed, state: State) -> State:
    """Return the state one iteration on: extrapolate, weights, bones; extrapolation that does harm is taken back."""
    motion = state.motion
    if state.beta > 0:
        motion = project(motion + state.beta * (motion - state.before))
    flat = motion.reshape(3 * data.frames, -1)
    bones = motion.shape[2]
    carried = ((flat.T @ data.basis) @ data.coefficients).reshape(bones, 4, -1)
    index, weights, error = solve_weights(
        monomials(data.points),
        gram_table(flat.T @ flat),
        np.einsum("bpn,np->nb", carried, data.points),
        (data.coefficients**2).sum(0),
        state.bone_index,
        state.weights,
        rounds=FIRST_ROUNDS if state.iteration == 0 else ROUNDS,
    )
    index, weights = reseed(data.points[:, :3], index, weights, error, bones)
    z = weighted_points(data.points, dense(index, weights, bones))
    uu = z.T @ z
    vu = (data.basis @ (data.coefficients @ z)).reshape(data.frames, 3, -1)
    motion = sweep(motion, uu, vu, SWEEPS)
    flat = motion.reshape(3 * data.frames, -1)
    energy = float(
        np.sum(data.coefficients**2) - 2 * np.sum(flat * vu.reshape(flat.shape)) + np.sum((flat.T @ flat) * uu)
    )
    if energy > state.energy and state.beta > 0:
        return replace(state, iteration=state.iteration + 1, beta=0.0)
    beta = min(state.beta + BETA_STEP, BETA_MOST)
    return State(state.iteration + 1, motion, state.motion, index, weights, energy, beta)


def reseed(
    rest: Float[np.ndarray, "n 3"],
    index: Int[np.ndarray, "n k"],
    weights: Float[np.ndarray, "n k"],
    error: Float[np.ndarray, "n"],
    bones: int,
) -> tuple[Int[np.ndarray, "n k"], Float[np.ndarray, "n k"]]:
    """Give a bone that no vertex uses to the worst-fitted vertex and its neighbours, which then hold nothing else.

    No vertex is taken that alone keeps another bone in use; as there are no more bones than vertices, one can be found.
    """
    mass = np.bincount(index.ravel(), weights.ravel() ** 2, bones)
    error = error.copy()
    for bone in np.flatnonzero(mass < UNUSED):
        seed = None
        for i in np.argsort(-error, kind="stable"):
            if _spare(mass, index[i], weights[i]):
                seed = i
                break
        if seed is None:
            break
        nearest = np.argsort(((rest - rest[seed]) ** 2).sum(1), kind="stable")[:FEWEST]
        for i in [seed, *nearest[nearest != seed][: FEWEST - 1]]:
            if _spare(mass, index[i], weights[i]):
                mass -= np.bincount(index[i], weights[i] ** 2, bones)
                index[i], weights[i], error[i] = 0, 0.0, 0.0
                index[i, 0], weights[i, 0] = bone, 1.0
                mass[bone] += 1.0
    return index, weights


def _spare(mass: np.ndarray, index: np.ndarray, weights: np.ndarray) -> bool:
    """Whether a vertex's bones all stay in use without it."""
    used = weights > 0
    return bool(np.all(mass[index[used]] - weights[used] ** 2 >= UNUSED))


def dense(
    index: Int[np.ndarray, "n k"], weights: Float[np.ndarray, "n k"], bones: int
) -> Float[np.ndarray, "n bones"]:
    """Return sparse weights as a matrix."""
    result = np.zeros((len(index), bones))
    np.add.at(result, (np.arange(len(index))[:, None], index), weights)
    return result
