"""Procrustes sweeps against their clear twin and against motions that are known."""

import numpy as np

from replicate.baselines.skinning.bones import project, rotation_of, sweep, sweep_reference, weighted_points
from replicate.geometry.alignment import nearest_rotation


def turns(rng, *shape, angle=0.4):
    """Random proper rotations, moderately far from the identity."""
    return nearest_rotation(np.eye(3) + angle * rng.normal(size=(*shape, 3, 3)))


def skinning_problem(frames=6, bones=4, n=60, seed=0):
    """Known motions, smooth weights and the displacements that they make."""
    rng = np.random.default_rng(seed)
    points = np.concatenate([rng.normal(size=(n, 3)), np.ones((n, 1))], 1)
    weights = rng.dirichlet(np.full(bones, 0.3), n)
    motion = np.zeros((frames, 3, bones, 4))
    motion[..., :3] = (turns(rng, frames, bones) - np.eye(3)).transpose(0, 3, 1, 2)
    motion[..., 3] = 0.3 * rng.normal(size=(frames, 3, bones))
    z = weighted_points(points, weights)
    displacement = motion.reshape(3 * frames, -1) @ z.T
    return motion, z, displacement


def normal_equations(z, displacement):
    return z.T @ z, (displacement @ z).reshape(len(displacement) // 3, 3, -1)


def test_the_rotation_of_a_matrix_is_that_of_its_singular_vectors_and_never_a_reflection():
    rng = np.random.default_rng(1)
    for _ in range(200):
        matrix = rng.normal(size=(3, 3)) * 10 ** rng.uniform(-9, 9)
        turn = rotation_of(matrix)
        np.testing.assert_allclose(turn, nearest_rotation(matrix), atol=1e-7)
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(turn) > 0
    for matrix in (np.zeros((3, 3)), np.eye(3), -np.eye(3), np.diag([1.0, 1, -1]), np.diag([1.0, 0, 0])):
        turn = rotation_of(matrix)
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(turn) > 0
        best = np.linalg.svd(matrix)[1] @ [1, 1, np.sign(np.linalg.det(matrix) + 1e-300)]
        assert np.isclose(np.trace(turn.T @ matrix), best)


def test_a_sweep_and_its_twin_move_the_bones_alike():
    motion, z, displacement = skinning_problem()
    uu, vu = normal_equations(z, displacement + 0.05 * np.random.default_rng(2).normal(size=displacement.shape))
    fast = sweep(motion * 0, uu, vu, 3)
    clear = motion * 0
    for _ in range(3):
        clear = sweep_reference(clear, uu, vu)
    np.testing.assert_allclose(fast, clear, atol=1e-9)
    assert np.abs(fast).max() > 0.1


def test_sweeps_lower_the_error_each_time_and_stop_at_the_motions_that_made_the_mesh():
    motion, z, displacement = skinning_problem()
    uu, vu = normal_equations(z, displacement)
    guess = motion * 0
    errors = []
    for _ in range(40):
        guess = sweep(guess, uu, vu, 5)
        errors.append(((guess.reshape(displacement.shape[0], -1) @ z.T - displacement) ** 2).sum())
    assert (np.diff(errors) <= 1e-12).all() and errors[-1] < 1e-4 * errors[0]
    np.testing.assert_allclose(sweep(motion, uu, vu, 3), motion, atol=1e-8)


def test_a_bone_without_weight_stays_and_disturbs_nothing():
    _, z, displacement = skinning_problem()
    padded = np.concatenate([z, np.zeros((len(z), 4))], 1)
    uu, vu = normal_equations(padded, displacement)
    begin = np.zeros((6, 3, 5, 4))
    begin[:, 0, 4, 3] = 0.7
    result = sweep(begin, uu, vu, 4)
    np.testing.assert_array_equal(result[:, :, 4], begin[:, :, 4])
    alone = sweep(begin[:, :, :4], *normal_equations(z, displacement), 4)
    np.testing.assert_allclose(result[:, :, :4], alone, atol=1e-12)


def test_a_bone_of_one_vertex_translates_and_keeps_its_rotation():
    points = np.array([[0.3, -0.2, 0.5, 1.0]])
    displacement = np.array([[0.1], [0.2], [-0.3]])
    result = sweep(np.zeros((1, 3, 1, 4)), *normal_equations(points, displacement), 2)
    np.testing.assert_allclose(result[0, :, 0, :3], 0, atol=1e-6)
    np.testing.assert_allclose(result[0, :, 0] @ points[0], displacement[:, 0], atol=1e-12)


def test_projection_returns_rotations_and_leaves_them_as_they_are():
    motion, _, _ = skinning_problem()
    np.testing.assert_allclose(project(motion), motion, atol=1e-10)
    stretched = project(motion * 1.7)
    linear = stretched[..., :3].transpose(0, 2, 3, 1) + np.eye(3)
    np.testing.assert_allclose(linear @ linear.swapaxes(-1, -2), np.broadcast_to(np.eye(3), linear.shape), atol=1e-10)
