"""The weight step of SSDR: with the bones fixed, find every vertex's sparse convex weights (Le & Deng 2012, §4).

For one vertex let s_b be what remains of its displacement in all poses when bone b alone carries it, and G = sᵀs their
Gram matrix. As the weights sum to one, the squared error is wᵀGw, to be minimised over w ≥ 0, Σw = 1, with at most
`influences` non-zeros. An active set does it: solve on the support, step back to the first weight that would turn
negative and drop it, add the bone whose gradient promises most, and when the support is full remove the bone that
costs least, w_b² / P_bb with P = G⁻¹ − yyᵀ/Σy, y = G⁻¹1. It starts from the last weights and never makes them worse.
"""

from typing import no_type_check

import numpy as np
from jaxtyping import Float, Int
from numba import njit

from replicate.base.jit_cache import kept

# The pairs of components of p = (x, y, z, 1) in the order of the ten monomials.
FIRST = np.array([0, 1, 2, 0, 0, 1, 0, 1, 2, 3])
SECOND = np.array([0, 1, 2, 1, 2, 2, 3, 3, 3, 3])
ROUNDS = 6  # bones added a vertex and step; the next step goes on from there


def gram_table(gram: Float[np.ndarray, "k k"]) -> Float[np.ndarray, "10 bones bones"]:
    """Return the ten matrices whose sum, weighted by the monomials of p, is the bones' Gram matrix at p.

    gram: (4B, 4B), MᵀM of the motions. With it H_ab(p) = (M_a p)·(M_b p) costs 10 B² and not 3 f B².
    """
    bones = len(gram) // 4
    blocks = gram.reshape(bones, 4, bones, 4)
    table = blocks[:, FIRST, :, SECOND]  # (10, B, B): numpy puts the paired index first
    mirrored = blocks[:, SECOND, :, FIRST]
    return np.where((FIRST == SECOND)[:, None, None], table, table + mirrored)


def monomials(points: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 10"]:
    """Return the products of two components of p that weigh the matrices of `gram_table`."""
    return points[:, FIRST] * points[:, SECOND]


def solve_reference(
    gram: Float[np.ndarray, "bones bones"], start: Float[np.ndarray, " bones"], influences: int, rounds: int = ROUNDS
) -> Float[np.ndarray, " bones"]:
    """Return one vertex's weights (bones,) from its G and a feasible start; the reference for `solve_weights`."""
    best = descend_reference(gram, start)
    for _ in range(rounds):
        gradient = gram @ best
        energy = best @ gradient
        gain = np.where(best > 0, np.inf, gradient - energy)
        new = int(np.argmin(gain))
        if not gain[new] < -1e-6 * energy:
            break
        support = [*np.flatnonzero(best > 0).tolist(), new]
        trial = descend_reference(gram, best, support)
        if np.count_nonzero(trial) > influences:
            support = np.flatnonzero(trial)
            inverse = np.linalg.inv(gram[np.ix_(support, support)])
            y = inverse.sum(1)
            cost = trial[support] ** 2 / np.diag(inverse - np.outer(y, y) / y.sum())
            trial[support[np.argmin(cost)]] = 0
            trial = descend_reference(gram, trial / trial.sum())
        if not trial @ gram @ trial < energy:
            break
        best = trial
    return best


def descend_reference(
    gram: Float[np.ndarray, "bones bones"], start: Float[np.ndarray, " bones"], support: list[int] | None = None
) -> Float[np.ndarray, " bones"]:
    """Return the weights that minimise wᵀGw on a support, and drop bones that would turn negative one by one."""
    weights = start.copy()
    support = np.flatnonzero(weights > 0) if support is None else np.array(support)
    while True:
        y = np.linalg.solve(gram[np.ix_(support, support)], np.ones(len(support)))
        optimum, current = y / y.sum(), weights[support]
        negative = optimum <= 0
        if not negative.any():
            weights[support] = optimum
            return weights
        steps = np.where(negative, current / np.where(negative, current - optimum, 1.0), np.inf)
        drop = int(np.argmin(steps))
        weights[support] = current + steps[drop] * (optimum - current)
        weights[support[drop]] = 0
        support = np.delete(support, drop)


def solve_weights(
    products: Float[np.ndarray, "n 10"],
    table: Float[np.ndarray, "10 bones bones"],
    projection: Float[np.ndarray, "n bones"],
    square: Float[np.ndarray, " n"],
    bone_index: Int[np.ndarray, "n k"],
    weights: Float[np.ndarray, "n k"],
    rounds: int = ROUNDS,
) -> tuple[Int[np.ndarray, "n k"], Float[np.ndarray, "n k"], Float[np.ndarray, " n"]]:
    """Return bones, weights and squared error (without the ridge) of every vertex; unused places have weight 0, bone 0.

    products: the monomials of the rest points.
    table: of `gram_table`.
    projection: (M_b p)·x of each bone with the vertex's displacement x.
    square: x·x.
    bone_index, weights: where to start, with k influences.
    rounds: bones added a vertex at most.
    """
    n, bones = projection.shape
    index, result, error = np.zeros_like(bone_index), np.zeros_like(weights), np.empty(n)
    flat = table.reshape(10, bones * bones)
    solve_all(products, flat, projection, square, bone_index, weights, rounds, index, result, error)
    return index, result, error


# The compiled active set; `solve_reference` is its readable reference.


@kept
@njit(fastmath={"reassoc", "contract", "nsz"})
@no_type_check
def solve_all(
    products: np.ndarray, table: np.ndarray, projection: np.ndarray, square: np.ndarray,
    old_index: np.ndarray, old_weights: np.ndarray, rounds: int,
    index: np.ndarray, result: np.ndarray, error: np.ndarray,
) -> None:  # fmt: skip
    """Solve for the weights of all vertices as `solve_weights` does, whose arguments come first.

    table: (10, bones²).
    old_index, old_weights: where to start.
    index, result, error: arrays to fill, of which the first two hold zeros.
    """
    n, bones = projection.shape
    influences = old_index.shape[1]
    room = influences + 1
    flat = np.empty(bones * bones)
    gram = flat.reshape(bones, bones)
    gradient = np.empty(bones)
    support = np.empty(room, np.int64)
    weights = np.empty(room)
    trial_support = np.empty(room, np.int64)
    trial = np.empty(room)
    factor = np.empty((room, room))
    y = np.empty(room)
    inside = np.zeros(bones, np.bool_)
    for i in range(n):
        # the vertex's Gram matrix, with a slight ridge
        for j in range(bones * bones):
            flat[j] = 0.0
        for m in range(10):
            scale = products[i, m]
            row = table[m]
            for j in range(bones * bones):
                flat[j] += scale * row[j]
        trace = 0.0
        for a in range(bones):
            shift = square[i] - projection[i, a]
            for b in range(bones):
                gram[a, b] += shift - projection[i, b]
            trace += gram[a, a]
        ridge = 1e-9 * max(trace, 0.0) / bones + 1e-11 * square[i] + 1e-30
        for a in range(bones):
            gram[a, a] += ridge
        # the best weights on the bones that it has
        size = 0
        for k in range(influences):
            if old_weights[i, k] > 0:
                support[size] = old_index[i, k]
                weights[size] = old_weights[i, k]
                size += 1
        size = _descend(gram, support, weights, size, influences, factor, y)
        # another bone as long as one helps
        for _ in range(rounds):
            energy = _gradient(gram, support, weights, size, gradient)
            for k in range(size):
                inside[support[k]] = True
            new, gain = -1, np.inf
            for b in range(bones):
                if not inside[b] and gradient[b] - energy < gain:
                    new, gain = b, gradient[b] - energy
            for k in range(size):
                inside[support[k]] = False
            if not gain < -1e-6 * energy:
                break
            trial_support[:size] = support[:size]
            trial[:size] = weights[:size]
            trial_support[size] = new
            trial[size] = 0.0
            trial_size = _descend(gram, trial_support, trial, size + 1, influences, factor, y)
            if not _energy(gram, trial_support, trial, trial_size) < energy:
                break
            size = trial_size
            support[:size] = trial_support[:size]
            weights[:size] = trial[:size]
        # what it has in the end, and the error without the ridge
        squares = 0.0
        for k in range(size):
            index[i, k] = support[k]
            result[i, k] = weights[k]
            squares += weights[k] * weights[k]
        error[i] = max(_energy(gram, support, weights, size) - ridge * squares, 0.0)


@kept
@njit(fastmath={"reassoc", "contract", "nsz"})
@no_type_check
def _descend(gram, support, weights, size, influences, factor, y):
    """Minimise on the support in place, without bones that would turn negative or are too many; return its new size."""
    while size > 1:
        _factorise(gram, support, size, factor)
        _solve_ones(factor, size, y)
        total = 0.0
        for a in range(size):
            total += y[a]
        drop, step = -1, np.inf
        for a in range(size):
            share = y[a] / total
            if share <= 0:
                length = weights[a] / (weights[a] - share) if weights[a] > share else 0.0
                if length < step:
                    drop, step = a, length
        if drop >= 0:
            for a in range(size):
                weights[a] += step * (y[a] / total - weights[a])
            size = _remove(support, weights, size, drop)
            continue
        for a in range(size):
            weights[a] = y[a] / total
        if size <= influences:
            return size
        drop = _cheapest(weights, size, factor, y, total)
        size = _remove(support, weights, size, drop)
        total = 0.0
        for a in range(size):
            total += weights[a]
        for a in range(size):
            weights[a] /= total
    weights[0] = 1.0
    return size


@kept
@njit
@no_type_check
def _cheapest(weights, size, factor, y, total):
    """Return the place in the support whose removal raises the energy least."""
    column = np.empty(size)
    cheapest, least = 0, np.inf
    for b in range(size):
        diagonal = 0.0  # of the inverse at b: the squared norm of column b of the inverse factor
        for a in range(b, size):
            value = 1.0 if a == b else 0.0
            for k in range(b, a):
                value -= factor[a, k] * column[k]
            column[a] = value / factor[a, a]
            diagonal += column[a] * column[a]
        cost = weights[b] * weights[b] / (diagonal - y[b] * y[b] / total)
        if cost < least:
            cheapest, least = b, cost
    return cheapest


@kept
@njit
@no_type_check
def _remove(support, weights, size, place):
    for a in range(place, size - 1):
        support[a] = support[a + 1]
        weights[a] = weights[a + 1]
    return size - 1


@kept
@njit
@no_type_check
def _factorise(gram, support, size, factor):
    """Write the Cholesky factor of the Gram matrix on the support, its lower triangle."""
    for a in range(size):
        for b in range(a + 1):
            value = gram[support[a], support[b]]
            for k in range(b):
                value -= factor[a, k] * factor[b, k]
            if a == b:
                floor = 1e-14 * gram[support[a], support[a]]
                factor[a, a] = np.sqrt(max(value, floor))
            else:
                factor[a, b] = value / factor[b, b]


@kept
@njit
@no_type_check
def _solve_ones(factor, size, y):
    """Solve G y = 1 from the Cholesky factor."""
    for a in range(size):
        value = 1.0
        for k in range(a):
            value -= factor[a, k] * y[k]
        y[a] = value / factor[a, a]
    for a in range(size - 1, -1, -1):
        value = y[a]
        for k in range(a + 1, size):
            value -= factor[k, a] * y[k]
        y[a] = value / factor[a, a]


@kept
@njit(fastmath={"reassoc", "contract", "nsz"})
@no_type_check
def _gradient(gram, support, weights, size, gradient):
    """Fill in Gw for all bones and return wᵀGw."""
    for b in range(len(gradient)):
        gradient[b] = 0.0
    for k in range(size):
        row = gram[support[k]]
        for b in range(len(gradient)):
            gradient[b] += weights[k] * row[b]
    energy = 0.0
    for k in range(size):
        energy += weights[k] * gradient[support[k]]
    return energy


@kept
@njit
@no_type_check
def _energy(gram, support, weights, size):
    total = 0.0
    for a in range(size):
        for b in range(size):
            total += weights[a] * weights[b] * gram[support[a], support[b]]
    return total
