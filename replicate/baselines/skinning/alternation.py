"""The alternation of SSDR: its state, one iteration, and what becomes of bones that no vertex uses."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array

from replicate.baselines.skinning.bones import project, sweep, weighted_points
from replicate.baselines.skinning.clusters import FEWEST
from replicate.baselines.skinning.compression import CompressedPoses, Metric
from replicate.baselines.skinning.weights import ROUNDS, gram_table, monomials, solve_weights

SWEEPS = 3  # Gauss–Seidel sweeps over the bones in each iteration
BETA_STEP, BETA_MOST = 0.1, 0.9  # of the extrapolation
FIRST_ROUNDS = 24  # additions a vertex in the first iteration, which starts from one bone
LEAST_MASS = 1e-2  # Σ w² of a bone below which it carries nothing


@dataclass(frozen=True)
class Problem:
    """The poses and the metric of a fit, and what follows from both alone while bones and weights change."""

    data: CompressedPoses
    metric: Metric

    @cached_property
    def constant(self) -> float:
        """The energy of a skin that never moves, in units of the rest radius squared."""
        y = self.data.coefficients.T
        return float(np.sum(y * (self.metric.matrix @ y)))

    @cached_property
    def neighbourhoods(self) -> tuple[tuple[Int[np.ndarray, " c"], csr_array, Float[np.ndarray, " c"]], ...]:
        """Every colour's vertices, their rows of K over their diagonal, and ‖Σ_j (K_ij / K_ii) x_j‖² of each."""
        diagonal = self.metric.matrix.diagonal()
        y = np.ascontiguousarray(self.data.coefficients.T)
        neighbourhoods = []
        for colour in self.metric.colours:
            share = csr_array(self.metric.matrix[colour] / diagonal[colour, None])
            neighbourhoods.append((colour, share, ((share @ y) ** 2).sum(1)))
        return tuple(neighbourhoods)


@dataclass(frozen=True)
class State:
    """A fit after some iterations: everything that the next one depends on.

    iteration: how many there were.
    motion: (f, 3, bones, 4), from the last bone step.
    before: the same, from the step before it.
    bone_index: (n, k) int64.
    weights: (n, k) float64.
    energy: the summed squared error in units of the rest radius.
    beta: how far the next iteration extrapolates.
    """

    iteration: int
    motion: Float[np.ndarray, "f 3 bones 4"]
    before: Float[np.ndarray, "f 3 bones 4"]
    bone_index: Int[np.ndarray, "n k"]
    weights: Float[np.ndarray, "n k"]
    energy: float
    beta: float


def normal_equations(
    problem: Problem, index: Int[np.ndarray, "n k"], weights: Float[np.ndarray, "n k"], bones: int
) -> tuple[Float[np.ndarray, "j j"], Float[np.ndarray, "f 3 j"]]:
    """Return UU = ZᵀKZ and VU = Q Y K Z of the bone step."""
    data = problem.data
    z = weighted_points(data.points, dense(index, weights, bones))
    kz = problem.metric.matrix @ z
    return z.T @ kz, (data.basis @ (data.coefficients @ kz)).reshape(data.frames, 3, -1)


def step(problem: Problem, state: State) -> State:
    """Return the state one iteration on: extrapolate, weights, bones; extrapolation that does harm is taken back."""
    motion = state.motion
    if state.beta > 0:
        motion = project(motion + state.beta * (motion - state.before))
    bones = motion.shape[2]
    index, weights, error = improve_weights(problem, motion, state.bone_index, state.weights, state.iteration == 0)
    index, weights = reseed(problem.data.points[:, :3], index, weights, error, bones)
    uu, vu = normal_equations(problem, index, weights, bones)
    motion = sweep(motion, uu, vu, SWEEPS)
    flat = motion.reshape(3 * problem.data.frames, -1)
    energy = float(problem.constant - 2 * np.sum(flat * vu.reshape(flat.shape)) + np.sum((flat.T @ flat) * uu))
    if energy > state.energy and state.beta > 0:
        return replace(state, iteration=state.iteration + 1, beta=0.0)
    beta = min(state.beta + BETA_STEP, BETA_MOST)
    return State(state.iteration + 1, motion, state.motion, index, weights, energy, beta)


def improve_weights(
    problem: Problem,
    motion: Float[np.ndarray, "f 3 bones 4"],
    index: Int[np.ndarray, "n k"],
    weights: Float[np.ndarray, "n k"],
    first: bool,
) -> tuple[Int[np.ndarray, "n k"], Float[np.ndarray, "n k"], Float[np.ndarray, " n"]]:
    """Return better bones and weights for fixed motions, and the squared errors that they leave.

    Vertices of one colour do not see each other in the metric. With its neighbours' errors r_j held, a vertex's part of
    the energy is K_ii ‖r_i + Σ_j≠i (K_ij / K_ii) r_j‖²: the plain problem for a displacement x_i that is shifted by the
    neighbours' errors. As r_j = x_j − M z_j and with s_j = K_ij / K_ii, that is Σ_j s_j x_j + M (z_i − Σ_j s_j z_j),
    sums over all j, whose products with the motions are sums of those of the x_j.

    problem: the poses and the metric.
    motion: of the bones.
    index, weights: where to start.
    first: whether this is the first iteration, which adds more bones to a vertex.
    """
    # products of all motions with one another, and of every displacement with them
    data, bones = problem.data, motion.shape[2]
    flat = motion.reshape(3 * data.frames, -1)
    gram = flat.T @ flat  # MᵀM
    table = gram_table(gram)
    onto_motions = data.coefficients.T @ (data.basis.T @ flat)  # (n, 4B), (Mᵀx_i)ᵀ
    z = weighted_points(data.points, dense(index, weights, bones))
    index, weights, error = index.copy(), weights.copy(), np.empty(len(index))
    # the vertices of one colour at a time, shifted by what their neighbours leave
    for colour, share, square in problem.neighbourhoods:
        projection, change = share @ onto_motions, z[colour] - share @ z
        together = change @ gram
        square = square + (change * (together + 2 * projection)).sum(1)
        index[colour], weights[colour], error[colour] = solve_weights(
            monomials(data.points[colour]),
            table,
            np.einsum("nbp,np->nb", (projection + together).reshape(-1, bones, 4), data.points[colour]),
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
    """Give each bone that no vertex uses to the worst-fitted vertex and its neighbours, which then have no other bone.

    A vertex that alone keeps another bone in use is not taken. As there are no more bones than vertices, others exist.

    rest: positions of the vertices.
    index, weights: bones of the vertices, changed in place.
    error: of the vertices, squared.
    bones: how many.
    """
    mass = np.bincount(index.ravel(), weights.ravel() ** 2, bones)
    error = error.copy()
    for bone in np.flatnonzero(mass < LEAST_MASS):
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
    """Return whether all bones of a vertex stay in use without it."""
    used = weights > 0
    return bool(np.all(mass[index[used]] - weights[used] ** 2 >= LEAST_MASS))


def dense(index: Int[np.ndarray, "n k"], weights: Float[np.ndarray, "n k"], bones: int) -> Float[np.ndarray, "n bones"]:
    """Return sparse weights as a matrix."""
    result = np.zeros((len(index), bones))
    np.add.at(result, (np.arange(len(index))[:, None], index), weights)
    return result


def sparse(
    weights: Float[np.ndarray, "n bones"], influences: int
) -> tuple[Int[np.ndarray, "n k"], Float[np.ndarray, "n k"]]:
    """Return the largest weights of every vertex and their bones, rescaled to sum to one; unused places hold 0."""
    count = min(influences, weights.shape[1])
    index = np.zeros((len(weights), influences), np.int64)
    result = np.zeros((len(weights), influences))
    index[:, :count] = np.argsort(-weights, axis=1, kind="stable")[:, :count]
    result[:, :count] = np.take_along_axis(weights, index[:, :count], 1)
    return index, result / result.sum(1, keepdims=True)
