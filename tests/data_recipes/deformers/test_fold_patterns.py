"""Rows of folds: even where a recipe asks for even ones, and otherwise different in spacing, depth and length."""

import numpy as np
import pytest

from data_recipes.deformers.wrinkle_regions import DEEPEST, SHALLOWEST, random_field, ridges, stream, uneven
from data_recipes.recipe.sections import Wrinkles


def skin(folds: int = 8, width_mm: float = 100.0, wavelength_mm: float = 8.0) -> tuple[np.ndarray, np.ndarray]:
    """Return the even phase and the place along the folds of a dense patch."""
    up, along = np.meshgrid(np.linspace(0, folds, 60 * folds), np.linspace(0, width_mm, 101), indexing="ij")
    return up.ravel(), along.ravel()


def row(unevenness: float, seed: int = 0, name: str = "forehead"):
    phase, along = skin()
    wrinkles = Wrinkles(unevenness=unevenness, tension=0.02)
    return uneven(phase, along, 8.0, wrinkles, stream(seed, name))


def widths(phase: np.ndarray) -> np.ndarray:
    """Return the distances of neighbouring valleys, in even folds, along all lines across the folds."""
    across = ridges(phase).reshape(-1, 101)
    inner = across[1:-1]
    valleys = (inner < across[:-2]) & (inner < across[2:]) & (inner < -1.0)
    return np.concatenate([np.diff(np.flatnonzero(valleys[:, k])) for k in range(101)]) / 60


def test_without_unevenness_the_row_is_the_even_one():
    phase, _ = skin()
    even = row(0.0)
    np.testing.assert_allclose(even.phase, phase)
    np.testing.assert_allclose(even.amplitude, 1)
    np.testing.assert_allclose(even.wavelength_mm, 8)
    np.testing.assert_allclose(even.threshold, 0.02)
    np.testing.assert_allclose(widths(even.phase), 1, atol=0.05)


def test_uneven_folds_differ_in_width_and_depth():
    rows = [row(1.0, seed) for seed in range(6)]
    assert np.mean([widths(folds.phase).std() for folds in rows]) > 0.12
    assert np.mean([folds.amplitude.std() for folds in rows]) > 0.2
    for folds in rows:
        assert folds.amplitude.min() >= 0 and folds.amplitude.max() <= DEEPEST
        assert SHALLOWEST < np.median(folds.amplitude) < DEEPEST


def test_folds_branch_a_line_across_meets_more_of_them_in_one_place_than_in_another():
    counts = {len(np.flatnonzero(np.diff(np.round(column)))) for column in row(1.0).phase.reshape(-1, 101).T}
    assert len(counts) > 1


def test_the_deepest_folds_appear_first_and_none_below_the_tension():
    folds = row(1.0)
    order = np.argsort(folds.amplitude)
    assert (np.diff(folds.threshold[order]) <= 1e-12).all()
    assert 0.02 <= folds.threshold.min() < folds.threshold.max() <= 0.08 + 1e-12


def test_wave_lengths_follow_the_widths():
    folds = row(1.0)
    slope = np.gradient(folds.phase.reshape(-1, 101), 1 / 60, axis=0).ravel()
    ordinary = (folds.amplitude > 0.8) & (np.abs(slope - 1) < 0.5)  # away from branches
    assert np.corrcoef(8.0 / folds.wavelength_mm[ordinary], slope[ordinary])[0, 1] > 0.8


def test_regions_and_seeds_have_random_numbers_of_their_own():
    assert np.array_equal(row(1.0).phase, row(1.0).phase)
    assert not np.allclose(row(1.0).phase, row(1.0, seed=1).phase)
    assert not np.allclose(row(1.0).phase, row(1.0, name="chin").phase)


@pytest.mark.parametrize("dimensions", (1, 2))
def test_a_random_field_has_variance_one_and_the_gradient_it_says(dimensions):
    places = np.random.default_rng(1).uniform(0, 60, (4000, dimensions))
    values = np.stack([random_field(np.random.default_rng(seed), places)[0] for seed in range(20)])
    assert abs(values.var() - 1) < 0.15
    step = 1e-5 * np.eye(dimensions)
    slope = random_field(np.random.default_rng(3), places)[1]
    for axis in range(dimensions):
        ahead, behind = (random_field(np.random.default_rng(3), places + s * step[axis])[0] for s in (1, -1))
        np.testing.assert_allclose(slope[:, axis], (ahead - behind) / 2e-5, atol=1e-4)


def test_ridges_are_round_and_valleys_sharp():
    phase = np.linspace(0, 1, 1001)
    p = ridges(phase)
    assert p.argmin() == 500
    np.testing.assert_allclose(p[0], 0.68)
    assert abs(p[505] - p[500]) > 10 * abs(p[5] - p[0])
