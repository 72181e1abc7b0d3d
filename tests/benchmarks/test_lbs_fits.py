"""Fits of skins that are timed: when one has converged, and that it is as the library's."""

import numpy as np
import pytest
from skinned_sheets import folded_sheet

from replicate.benchmarks import lbs_fits


def test_a_fit_ends_when_its_last_iterations_gain_next_to_nothing():
    course, iteration = lbs_fits.Course([], []), 0
    while course.go_on(iteration, float(iteration), 1.0 + 0.9**iteration):
        iteration += 1
    gain = 1 - course.rmse[-1] / course.rmse[-1 - lbs_fits.WINDOW]
    assert lbs_fits.LEAST < iteration < lbs_fits.MOST and 0 < gain < lbs_fits.LEAST_GAIN
    assert course.time_to(1.5) == 7 and course.time_to(0.9) == float("inf")


def test_a_fit_that_keeps_gaining_goes_on_to_the_most():
    course, iteration = lbs_fits.Course([], []), 0
    while course.go_on(iteration, 0.0, 0.9**iteration):
        iteration += 1
    assert iteration == lbs_fits.MOST


def test_ours_is_fitted_as_the_library_fits():
    from replicate.baselines.skinning.ssdr import fit
    from replicate.engine.stage import stream_rng

    neutral, poses, faces = folded_sheet()
    course = lbs_fits.Course([], [])
    course.go_on = lambda iteration, seconds, rmse: (course.rmse.append(rmse), iteration < 6)[1]
    skin = lbs_fits.fit_ours(neutral, poses, faces, 3, 0, course)
    same = fit(neutral, poses, 3, stream_rng(0, "lbs", "sketch"), iterations=6, faces=faces)
    np.testing.assert_array_equal(skin.dense_weights(), same.dense_weights())
    errors = lbs_fits.held_out(skin, poses, faces)
    motion = np.sqrt(((poses - neutral) ** 2).sum(-1).mean())
    assert 0 < errors["rmse"] <= course.rmse[-1] + 0.005 * motion, (
        "refitted bones are about as good as those of the fit"
    )
    assert errors["mean"] <= errors["rmse"] <= errors["max"]


def test_the_training_error_is_that_of_the_skinned_poses():
    from replicate.baselines.skinning.alternation import Problem, dense
    from replicate.baselines.skinning.bones import weighted_points
    from replicate.baselines.skinning.compression import compress, edge_metric
    from replicate.baselines.skinning.starts import start

    neutral, poses, faces = folded_sheet()
    data = compress(neutral, poses, np.random.default_rng(0))
    state = start(Problem(data, edge_metric(data.points[:, :3], faces, 0.1)), 3, 8)
    spread = weighted_points(data.points, dense(state.bone_index, state.weights, 3))
    moved = np.einsum("nj,fcj->fnc", spread, state.motion.reshape(len(poses), 3, -1)) * data.radius_mm
    exact = np.sqrt(((moved - (poses - neutral)) ** 2).sum(-1).mean())
    assert lbs_fits.training_rmse(data, state) == pytest.approx(exact, rel=1e-4)
