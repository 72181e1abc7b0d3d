"""Agreement of derivatives, and the solver that minimises Eq. 8 by iteration, on functions that are known."""

import numpy as np
import pytest
import torch

from replicate.inverse.control_points import Region
from replicate.inverse.solver import agreement, agreement_by_region, jacobians, solve

RNG = np.random.default_rng(0)
MATRIX = torch.from_numpy(RNG.normal(size=(6, 12)).astype(np.float32))


def positions(params):
    return (params @ MATRIX + 0.1 * (params**2) @ MATRIX).unflatten(1, (4, 3))


def test_jacobians_are_those_of_the_function():
    params = RNG.normal(size=(3, 6))
    exact = np.einsum("bm,mk->bkm", 1 + 0.2 * params, MATRIX.numpy()).reshape(3, 4, 3, 6)
    np.testing.assert_allclose(jacobians(positions, params), exact, atol=1e-5)


def test_a_derivative_agrees_with_itself_and_half_of_it_is_half_as_long():
    exact, ranges = RNG.normal(size=(3, 4, 3, 6)), np.ones(6)
    same, half, none = (agreement(each, exact, ranges) for each in (exact, exact / 2, np.zeros_like(exact)))
    assert same.cosine == pytest.approx(1) and same.size == pytest.approx(1)
    assert half.cosine == pytest.approx(1) and half.size == pytest.approx(0.5)
    assert none.cosine == 0 and none.size == pytest.approx(0)
    assert agreement(-exact, exact, ranges).cosine == pytest.approx(-1)


def test_parameters_are_weighed_by_their_ranges():
    exact = np.ones((1, 1, 3, 2))
    wrong = exact * [1, -1]
    assert agreement(wrong, exact, np.array([1.0, 1.0])).cosine == pytest.approx(0)
    assert agreement(wrong, exact, np.array([1.0, 0.0])).cosine == pytest.approx(1)


def test_a_region_is_judged_by_its_own_points():
    exact = RNG.normal(size=(2, 4, 3, 6))
    wrong = exact.copy()
    wrong[:, 2:] *= -1
    regions = Region("eye", np.array([0, 1]), np.arange(6)), Region("mouth", np.array([2, 3]), np.arange(6))
    found = agreement_by_region(wrong, exact, np.ones(6), regions)
    assert found["eye"].cosine == pytest.approx(1) and found["mouth"].cosine == pytest.approx(-1)
    assert -1 < found[""].cosine < 1


def solved(targets, **changes):
    facts = {"regularisation": 0.0, "axes": 3, "driven": np.arange(6)} | changes
    limits = np.zeros(6, np.float32), np.full(6, -1, np.float32), np.ones(6, np.float32), np.full(6, 2.0, np.float32)
    return solve(positions, targets, *limits, facts["driven"], facts["axes"], facts["regularisation"])


def test_the_solver_finds_the_parameters_of_points_within_reach():
    params = RNG.uniform(-0.8, 0.8, (3, 6)).astype(np.float32)
    solution = solved(positions(torch.from_numpy(params)).numpy())
    np.testing.assert_allclose(solution.params, params, atol=0.02)
    assert 1 < solution.evaluations < 200


def test_the_solver_keeps_limits_and_moves_only_what_is_driven():
    far = np.full((2, 4, 3), 100.0, np.float32)
    assert np.abs(solved(far).params).max() <= 1 + 1e-6
    few = solved(far, driven=np.array([1, 4])).params
    assert (few[:, [0, 2, 3, 5]] == 0).all() and (few[:, [1, 4]] != 0).all()


def test_the_depth_of_a_point_counts_in_space_alone():
    params = RNG.uniform(-0.8, 0.8, (2, 6)).astype(np.float32)
    targets = positions(torch.from_numpy(params)).numpy()
    targets[..., 2] += 50.0
    np.testing.assert_allclose(solved(targets, axes=2).params, params, atol=0.02)
    assert np.abs(solved(targets, axes=3).params - params).max() > 0.1


def test_regularisation_keeps_the_solution_small():
    target = positions(torch.full((1, 6), 0.5)).numpy()
    assert np.abs(solved(target, regularisation=2.0).params).sum() < 0.5 * np.abs(solved(target).params).sum()
