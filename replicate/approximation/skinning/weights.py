"""The weight step of SSDR: with the bones fixed, find every vertex's sparse convex weights (Le & Deng 2012, §4).

For one vertex let s_b be what remains of its displacement in all poses when bone b alone carries it, and G = sᵀs their
Gram matrix. As the weights sum to one, the squared error is wᵀGw, to be minimised over w ≥ 0, Σw = 1, with at most
`influences` non-zeros. An active set does it: solve on the support, step back to the first weight that would turn
negative and drop it, add the bone whose gradient promises most, and when the support is full remove the bone that
costs least, w_b² / P_bb with P = G⁻¹ − yyᵀ/Σy, y = G⁻¹1. It starts from the last weights, and never ends worse.
"""

import numpy as np
from jaxtyping import Float, Int

from replicate.approximation.skinning.active_set import solve_all

# The pairs of components of p = (x, y, z, 1) in the order of the ten monomials.
FIRST = np.array([0, 1, 2, 0, 0, 1, 0, 1, 2, 3])
SECOND = np.array([0, 1, 2, 1, 2, 2, 3, 3, 3, 3])
ROUNDS = 6  # additions a vertex and step; the next step goes on from there


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
    """Return the products of two components of p that `gram_table` is weighted by."""
    return points[:, FIRST] * points[:, SECOND]


def residual_gram(
    table: Float[np.ndarray, "10 bones bones"],
    products: Float[np.ndarray, "10"],
    projection: Float[np.ndarray, " bones"],
    square: float,
) -> Float[np.ndarray, "bones bones"]:
    """Return one vertex's G, slightly ridged so that it stays positive where two bones agree.

    projection: (M_b p)·x of each bone with the vertex's displacement x; square: x·x.
    """
    gram = np.tensordot(products, table, 1) - projection[:, None] - projection[None, :] + square
    return gram + np.eye(len(gram)) * (1e-9 * max(np.trace(gram), 0.0) / len(gram) + 1e-11 * square + 1e-30)


def solve_reference(
    gram: Float[np.ndarray, "bones bones"], start: Float[np.ndarray, " bones"], influences: int, rounds: int = ROUNDS
) -> Float[np.ndarray, " bones"]:
    """Return one vertex's weights (bones,) from its G and a feasible start: the clear twin of `solve_weights`."""
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
    """Return the weights that minimise wᵀGw on a support, bones that would turn negative dropped one by one."""
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
    """Return bones, weights and squared error of every vertex, starting from those of `bone_index` and `weights`.

    k is the number of influences; unused places hold weight 0 (and bone 0). The squared error is without the ridge.
    """
    n, bones = projection.shape
    index, result, error = np.zeros_like(bone_index), np.zeros_like(weights), np.empty(n)
    flat = table.reshape(10, bones * bones)
    solve_all(products, flat, projection, square, bone_index, weights, rounds, index, result, error)
    return index, result, error
