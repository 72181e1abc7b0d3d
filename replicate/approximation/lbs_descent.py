"""The alternation of SSDR: its state, one iteration, and bones that nobody uses."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array

from replicate.approximation.lbs_bones import project, sweep, weighted_points
from replicate.approximation.lbs_clusters import FEWEST
from replicate.approximation.lbs_compression import Compressed
from replicate.approximation.lbs_metric import Metric
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


def normal_equations(
    data: Compressed, metric: Metric, index: Int[np.ndarray, "n k"], weights: Float[np.ndarray, "n k"], bones: int
) -> tuple[Float[np.ndarray, "j j"], Float[np.ndarray, "f 3 j"]]:
    """Return UU = ZᵀKZ and VU = Q Y K Z of the bone step."""
    z = weighted_points(data.points, dense(index, weights, bones))
    kz = metric.matrix @ z
    return z.T @ kz, (data.basis @ (data.coefficients @ kz)).reshape(data.frames, 3, -1)


def step(data: Compressed, metric: Metric, state: State) -> State:
    """Return the state one iteration on: extrapolate, weights, bones; extrapolation that does harm is taken back."""
    motion = state.motion
    if state.beta > 0:
        motion = project(motion + state.beta * (motion - state.before))
    bones = motion.shape[2]
    index, weights, error = improve_weights(data, metric, motion, state.bone_index, state.weights, state.iteration == 0)
    index, weights = reseed(data.points[:, :3], index, weights, error, bones)
    uu, vu = normal_equations(data, metric, index, weights, bones)
    motion = sweep(motion, uu, vu, SWEEPS)
    flat = motion.reshape(3 * data.frames, -1)
    constant = np.sum(data.coefficients.T * (metric.matrix @ data.coefficients.T))
    energy = float(constant - 2 * np.sum(flat * vu.reshape(flat.shape)) + np.sum((flat.T @ flat) * uu))
    if energy > state.energy and state.beta > 0:
        return replace(state, iteration=state.iteration + 1, beta=0.0)
    beta = min(state.beta + BETA_STEP, BETA_MOST)
    return State(state.iteration + 1, motion, state.motion, index, weights, energy, beta)


def improve_weights(
    data: Compressed,
    metric: Metric,
    motion: Float[np.ndarray, "f 3 bones 4"],
    index: Int[np.ndarray, "n k"],
    weights: Float[np.ndarray, "n k"],
    first: bool,
) -> tuple[Int[np.ndarray, "n k"], Float[np.ndarray, "n k"], Float[np.ndarray, " n"]]:
    """Return better bones, weights and the squared errors that they leave, the motions fixed.

    Vertices of one colour do not see each other in the metric. With its neighbours' errors r_j held, a vertex's part of
    the energy is K_ii ‖r_i + Σ_j≠i (K_ij / K_ii) r_j‖²: the plain problem for a displacement x_i that is shifted by the
    neighbours' errors. These lie in the span of Q and of the motions, so the shifted one is Q y + M z for some y and z.
    """
    bones = motion.shape[2]
    flat = motion.reshape(3 * data.frames, -1)
    gram, across = flat.T @ flat, flat.T @ data.basis  # MᵀM, MᵀQ
    table = gram_table(gram)
    y = np.ascontiguousarray(data.coefficients.T)
    z = weighted_points(data.points, dense(index, weights, bones))
    index, weights, error = index.copy(), weights.copy(), np.empty(len(index))
    diagonal = metric.matrix.diagonal()
    for colour in metric.colours:
        rows = metric.matrix[colour]
        share = csr_array(rows / diagonal[colour, None])
        shifted_y, moved_z = share @ y, z[colour] - share @ z
        carried_flat = shifted_y @ across.T + moved_z @ gram
        square = (shifted_y**2).sum(1) + (moved_z * (carried_flat + shifted_y @ across.T)).sum(1)
        index[colour], weights[colour], error[colour] = solve_weights(
            monomials(data.points[colour]),
            table,
            np.einsum("nbp,np->nb", carried_flat.reshape(-1, bones, 4), data.points[colour]),
            square,
            index[colour],
            weights[colour],
            rounds=FIRST_ROUNDS if first else ROUNDS,
        )
        z[colour] = weighted_points(data.points[colour], dense(index[colour], weights[colour], bones))
    return index, weights, error


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


def dense(index: Int[np.ndarray, "n k"], weights: Float[np.ndarray, "n k"], bones: int) -> Float[np.ndarray, "n bones"]:
    """Return sparse weights as a matrix."""
    result = np.zeros((len(index), bones))
    np.add.at(result, (np.arange(len(index))[:, None], index), weights)
    return result


def sparse(
    weights: Float[np.ndarray, "n bones"], influences: int
) -> tuple[Int[np.ndarray, "n k"], Float[np.ndarray, "n k"]]:
    """Return the largest weights of every vertex and their bones, rescaled to sum to one; unused places hold 0."""
    kept = min(influences, weights.shape[1])
    index = np.zeros((len(weights), influences), np.int64)
    result = np.zeros((len(weights), influences))
    index[:, :kept] = np.argsort(-weights, axis=1, kind="stable")[:, :kept]
    result[:, :kept] = np.take_along_axis(weights, index[:, :kept], 1)
    return index, result / result.sum(1, keepdims=True)
