"""Table 2's errors: closed forms, what degenerate faces do, and statistics that need no second look at the data."""

import numpy as np
import pytest

from replicate.approximation.metrics import angle_between, new_tally, normal_error, summary, tally_add, vertex_error

CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32) * 40
CUBE_FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
     [1, 5, 7], [1, 7, 3]], np.int32,
)  # fmt: skip


def turned(vertices, degrees, axis):
    """Rodrigues' formula, in double precision."""
    axis = np.asarray(axis, float) / np.linalg.norm(axis)
    t = np.radians(degrees)
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    rotation = np.eye(3) + np.sin(t) * k + (1 - np.cos(t)) * k @ k
    return vertices @ rotation.T


def test_vertex_error_of_a_translation_is_its_length():
    assert vertex_error(CUBE + np.float32([2, 3, 6]), CUBE) == pytest.approx(np.full(8, 7.0), rel=1e-6)


@pytest.mark.parametrize("degrees", [1e-6, 0.01, 1, 37, 90, 179.99])
def test_eq_11_of_a_turned_mesh_is_the_closed_form(degrees):
    """A face whose normal makes the angle t with the axis turns by arccos(cos²t + sin²t cos φ)."""
    axis = np.array([1.0, 2.0, 2.0]) / 3
    error = normal_error(turned(CUBE.astype(float), degrees, axis), CUBE.astype(float), CUBE_FACES)
    normals = np.repeat([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]], 2, axis=0)
    sine = np.sqrt(1 - (normals @ axis) ** 2)
    expected = np.degrees(2 * np.arcsin(sine * np.sin(np.radians(degrees) / 2)))
    np.testing.assert_allclose(error, expected, rtol=1e-7)


def test_eq_11_ignores_translation_and_scale_and_sees_a_flip():
    assert normal_error(CUBE * 3 + 5, CUBE, CUBE_FACES).max() < 1e-4
    np.testing.assert_allclose(normal_error(CUBE, CUBE, CUBE_FACES[:, ::-1]), 0)
    assert normal_error(CUBE * np.float32([-1, 1, 1]), CUBE, CUBE_FACES)[:4].min() == pytest.approx(0, abs=1e-4)
    assert normal_error(CUBE * np.float32([-1, 1, 1]), CUBE, CUBE_FACES)[4:].min() == pytest.approx(180)


def test_small_angles_keep_their_digits_in_single_precision():
    small = np.float32([[1, 0, 0]]), np.float32([[1, 1e-5, 0]])
    assert angle_between(*small)[0] == pytest.approx(np.degrees(1e-5), rel=1e-5)
    assert np.degrees(np.arccos(np.float32(1))) == 0  # what Eq. 11's arccos makes of them


def test_a_face_without_area_is_left_out_of_the_mean_and_counted():
    squashed = CUBE.copy()
    squashed[1] = squashed[0]
    errors = normal_error(squashed[None], CUBE[None], CUBE_FACES)
    assert np.isnan(errors[0, [0, 5]]).all() and np.isfinite(np.delete(errors[0], [0, 5])).all()
    tally = new_tally(1)
    tally_add(tally, errors, np.zeros(12, np.int64))
    statistics = summary(tally)
    assert (statistics.count, statistics.left_out) == (10, 2)
    assert statistics.mean == pytest.approx(np.nanmean(errors), rel=1e-6)


def test_statistics_in_chunks_equal_those_of_all_values_at_once():
    rng = np.random.default_rng(1)
    errors = rng.lognormal(-2, 1.5, size=(50, 400)).astype(np.float32)
    group = rng.integers(0, 3, 400)
    tally = new_tally(3)
    for start in range(0, 50, 7):
        tally_add(tally, errors[start : start + 7], group)
    for g, values in [(None, errors), *((g, errors[:, group == g]) for g in range(3))]:
        statistics = summary(tally, g)
        assert statistics.mean == pytest.approx(values.mean(dtype=float), rel=1e-9)
        assert statistics.max == values.max()
        assert statistics.p95 == pytest.approx(np.percentile(values, 95), rel=4e-3)
        assert statistics.count == values.size


def test_a_perfect_prediction_has_zero_error_throughout():
    tally = new_tally(1)
    tally_add(tally, np.zeros((3, 5), np.float32), np.zeros(5, np.int64))
    assert (summary(tally).mean, summary(tally).p95, summary(tally).max) == (0, 0, 0)


def test_a_group_without_values_is_nan_rather_than_a_number():
    assert np.isnan(summary(new_tally(2), 1).mean)
