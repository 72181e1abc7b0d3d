"""Keys, blinks, drift and holds."""

import numpy as np

from data_recipes.acting import motion

ONE_LAG = np.zeros(1, dtype=int)


def test_a_pose_takes_both_sides_and_leaves_out_what_is_missing():
    columns = {"smile_left": 0, "smile_right": 1, "jaw_open": 2}
    assert motion.pose(columns, {"smile_*": 0.5, "jaw_open": 0.2, "tongue_out": 1.0}).tolist() == [0.5, 0.5, 0.2]


def test_curves_pass_through_their_keys_and_stay_between_them():
    keys = [(0.0, np.array([0.0])), (10.0, np.array([1.0])), (20.0, np.array([1.0])), (30.0, np.array([-1.0]))]
    curve = motion.through(keys, 31, ONE_LAG)[:, 0]
    assert np.allclose(curve[[0, 10, 20, 30]], [0, 1, 1, -1])
    assert np.allclose(curve[10:21], 1)
    assert (np.diff(curve[:11]) >= 0).all() and (np.diff(curve[20:]) <= 0).all()


def test_moves_ease_in_and_out():
    keys = motion.move_keys(0.0, 20.0, np.array([0.0]), np.array([1.0]), 0.0, 0.0)
    steps = np.diff(motion.through([*keys, (30.0, np.array([1.0]))], 31, ONE_LAG)[:, 0])
    assert steps[19] < 0.4 * steps.max()


def test_moves_anticipate_and_overshoot_by_their_shares():
    keys = motion.move_keys(5.0, 20.0, np.array([0.0]), np.array([2.0]), 0.1, 0.2)
    curve = motion.through(keys, 40, ONE_LAG)[:, 0]
    assert np.isclose(curve.min(), -0.2) and np.isclose(curve.max(), 2.4)
    assert np.isclose(curve[25], 2) and np.isclose(curve[39], 2) and curve[4] == 0


def test_lag_delays_a_control_by_whole_frames():
    keys = [(0.0, np.zeros(2)), (12.0, np.ones(2))]
    curve = motion.through(keys, 20, np.array([0, 3]))
    assert np.allclose(curve[3:, 1], curve[:-3, 0])


def test_a_blink_closes_fully_faster_than_it_opens():
    profile = motion.blink_profile(30, [5.0])
    frames = np.flatnonzero(profile > 0.99)
    assert profile.max() == 1 and profile.min() == 0
    assert frames[0] - 5 < 13 - frames[-1]
    assert not profile[:6].any() and not profile[13:].any()


def test_drift_is_slow_noise_of_unit_size():
    noise = motion.drift(20_000, 3, 30.0, np.random.default_rng(0))
    assert 0.6 < noise.std() < 1.1
    assert np.abs(np.diff(noise, axis=0)).max() < 0.5


def test_freezing_repeats_frames_and_changes_none():
    values = np.arange(10.0)[:, None]
    frozen = motion.freeze(values, {3: 4, 99: 2})
    assert frozen[:, 0].tolist() == [0, 1, 2, 3, 3, 3, 3, 3, 4, 5, 6, 7, 8, 9, 9, 9]
