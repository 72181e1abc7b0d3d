"""The active set against enumeration of every support, and the fast kernel against its clear twin."""

from itertools import combinations

import numpy as np

from replicate.baselines.skinning.weights import gram_table, monomials, solve_reference, solve_weights


def problem(n=40, bones=7, rank=9, seed=0):
    """Random motions (rows, 4 per bone), points and displacements."""
    rng = np.random.default_rng(seed)
    motion = rng.normal(size=(rank, 4 * bones))
    points = np.concatenate([rng.normal(size=(n, 3)), np.ones((n, 1))], 1)
    alone = np.einsum("rbp,np->nrb", motion.reshape(rank, bones, 4), points)
    mixed = rng.dirichlet(np.full(bones, 0.5), n)
    x = np.einsum("nrb,nb->nr", alone, mixed) + 0.3 * rng.normal(size=(n, rank))
    return motion, points, x, alone


def start(n, influences, bones, rng):
    index = np.zeros((n, influences), np.int64)
    weights = np.zeros((n, influences))
    index[:, 0] = rng.integers(bones, size=n)
    weights[:, 0] = 1
    return index, weights


def spread(index, weights, bones):
    result = np.zeros((len(index), bones))
    np.add.at(result, (np.arange(len(index))[:, None], index), weights)
    return result


def kernel(motion, points, x, alone, influences, rounds, seed=1):
    bones = alone.shape[2]
    index, weights = start(len(points), influences, bones, np.random.default_rng(seed))
    correlation = np.einsum("nrb,nr->nb", alone, x)
    table = gram_table(motion.T @ motion)
    solution = solve_weights(monomials(points), table, correlation, (x**2).sum(1), index, weights, rounds)
    return solution, spread(index, weights, bones), correlation, table


def residual_gram(table, products, projection, square):
    """Return one vertex's G with a slight ridge, so that it stays positive where two bones agree.

    projection: (M_b p)·x of each bone with the vertex's displacement x; square: x·x.
    """
    gram = np.tensordot(products, table, 1) - projection[:, None] - projection[None, :] + square
    return gram + np.eye(len(gram)) * (1e-9 * max(np.trace(gram), 0.0) / len(gram) + 1e-11 * square + 1e-30)


def test_the_table_of_monomials_gives_the_gram_matrix_of_the_residuals():
    motion, points, x, alone = problem()
    table, products = gram_table(motion.T @ motion), monomials(points)
    for i in range(len(points)):
        residual = alone[i] - x[i][:, None]
        gram = residual_gram(table, products[i], alone[i].T @ x[i], x[i] @ x[i])
        np.testing.assert_allclose(gram, residual.T @ residual, rtol=1e-6, atol=1e-6)


def test_the_reported_error_is_what_the_weights_leave_over():
    motion, points, x, alone = problem()
    (index, weights, error), *_ = kernel(motion, points, x, alone, 4, 20)
    left = np.einsum("nrb,nb->nr", alone, spread(index, weights, 7)) - x
    np.testing.assert_allclose(error, (left**2).sum(1), rtol=1e-6)


def test_with_room_for_every_bone_the_weights_are_the_best_of_all_supports():
    motion, points, x, alone = problem(n=25, bones=5)
    (index, weights, _), *_ = kernel(motion, points, x, alone, 5, 50)
    dense_weights = spread(index, weights, 5)
    for i in range(len(points)):
        residual = alone[i] - x[i][:, None]
        gram = residual.T @ residual
        best = np.inf
        for size in range(1, 6):
            for support in combinations(range(5), size):
                y = np.linalg.solve(gram[np.ix_(support, support)], np.ones(size))
                if (y / y.sum() >= 0).all():
                    best = min(best, 1 / y.sum())
        assert dense_weights[i] @ gram @ dense_weights[i] <= best * (1 + 1e-5)


def test_the_kernel_and_its_twin_find_the_same_weights():
    motion, points, x, alone = problem(n=200, bones=12)
    (index, weights, _), begin, correlation, table = kernel(motion, points, x, alone, 4, 6)
    fast = spread(index, weights, 12)
    clear = np.stack(
        [
            solve_reference(residual_gram(table, m, c, s), w, 4)
            for m, c, s, w in zip(monomials(points), correlation, (x**2).sum(1), begin, strict=True)
        ]
    )
    np.testing.assert_allclose(fast, clear, atol=1e-7)
    assert (fast > 0.01).sum(1).max() == 4 and np.abs(fast - begin).max() > 0.5


def test_weights_are_convex_and_no_more_than_allowed_and_never_worse_than_the_start():
    motion, points, x, alone = problem(n=300, bones=16)
    (index, weights, error), begin, *_ = kernel(motion, points, x, alone, 3, 1)
    first = ((np.einsum("nrb,nb->nr", alone, begin) - x) ** 2).sum(1)
    assert (error <= first * (1 + 1e-9)).all() and (error < first * 0.9).mean() > 0.5
    (index, weights, again) = kernel(motion, points, x, alone, 3, 20)[0]
    assert (again <= error * (1 + 1e-9)).all() and weights.shape == (300, 3)
    assert (weights >= 0).all()
    np.testing.assert_allclose(weights.sum(1), 1, atol=1e-12)
    for used, w in zip(index, weights, strict=True):
        assert len(set(used[w > 0])) == (w > 0).sum()


def test_bones_that_all_agree_leave_finite_weights():
    motion, points, x, _ = problem(bones=3)
    motion = np.tile(motion[:, :4], (1, 3))
    alone = np.einsum("rbp,np->nrb", motion.reshape(len(motion), 3, 4), points)
    for target in (x, alone[:, :, 0], np.zeros_like(x)):
        (_, weights, error), *_ = kernel(motion, points, target, alone, 2, 6)
        assert np.isfinite(weights).all() and np.isfinite(error).all()
        np.testing.assert_allclose(weights.sum(1), 1, atol=1e-12)
