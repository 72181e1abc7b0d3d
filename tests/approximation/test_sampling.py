"""The split, Eq. 5 and the balancing of §3.5."""

import numpy as np
import pytest
from sklearn.decomposition import PCA

from replicate.approximation import sampling
from replicate.base.exceptions import InputError


@pytest.fixture
def clips():
    rng = np.random.default_rng(0)
    moves = [rng.normal(size=(length, 5)).astype(np.float32) for length in (40, 70, 25, 65)]
    return [np.concatenate([move, np.repeat(move[-1:], 10, axis=0)]) for move in moves]  # each ends in a hold


def rows(poses):
    return {pose.tobytes() for pose in poses}


def test_test_frames_are_unique_and_unseen_in_training(clips):
    training, test = sampling.split_frames(clips, np.random.default_rng(1))
    assert len(rows(test)) == len(test)
    assert not rows(test) & rows(training)


def test_a_frame_split_holds_out_a_tenth_and_loses_no_pose(clips):
    training, test = sampling.split_frames(clips, np.random.default_rng(1))
    assert len(training) == 240 - 24
    assert rows(training) | rows(test) == rows(np.concatenate(clips))


def test_negative_zero_does_not_make_a_pose_unique():
    clip = np.zeros((20, 3), dtype=np.float32)
    clip[1::2] = -0.0
    with pytest.raises(InputError, match="unique test poses"):
        sampling.split_frames([clip], np.random.default_rng(0))


def test_a_clip_split_holds_out_whole_clips(clips):
    training, test = sampling.split_clips(clips, np.random.default_rng(3), held_out=0.25)
    for clip in clips:
        members = rows(clip)
        assert members <= rows(training) or members <= rows(test)
    assert 0 < len(test) <= 80


def test_the_split_follows_its_generator_alone(clips):
    first = sampling.split_frames(clips, np.random.default_rng(5))[1]
    again = sampling.split_frames(clips, np.random.default_rng(5))[1]
    other = sampling.split_frames(clips, np.random.default_rng(6))[1]
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_no_clips_is_an_input_error():
    with pytest.raises(InputError, match="no clips"):
        sampling.split_frames([], np.random.default_rng(0))


def test_augmentation_multiplies_raw_values_by_uniform_factors():
    poses = np.array([[1.0, -2.0, 0.0]], dtype=np.float32)
    samples = sampling.augment(poses, 40_000, np.random.default_rng(0))
    factors = samples[:, :2] / poses[0, :2]
    assert factors.min() >= 0.25 and factors.max() <= 3.0
    assert abs(factors.mean() - 1.625) < 0.01
    assert abs(factors.std() - 2.75 / np.sqrt(12)) < 0.01
    assert abs(np.corrcoef(factors.T)[0, 1]) < 0.02  # a factor a parameter, not one a pose
    assert not samples[:, 2].any()


def test_augmentation_draws_every_pose_about_equally_often():
    poses = np.arange(1, 11, dtype=np.float32)[:, None] * np.array([[1e4, 1.0]], dtype=np.float32)
    samples = sampling.augment(poses, 20_000, np.random.default_rng(1), low=1.0, high=1.0 + 1e-6)
    counts = np.bincount(np.rint(samples[:, 1]).astype(int), minlength=11)[1:]
    assert counts.min() > 1_800 and counts.max() < 2_200


def test_uniform_samples_fill_the_ranges_and_stay_inside():
    lower, upper = np.array([-1.0, 0.0, 2.0]), np.array([1.0, 5.0, 2.5])
    samples = sampling.sample_uniform(lower, upper, 5_000, np.random.default_rng(0))
    assert (samples >= lower).all() and (samples <= upper).all()
    assert np.allclose(samples.mean(axis=0), (lower + upper) / 2, atol=0.1)
    assert np.allclose(np.ptp(samples, axis=0), upper - lower, rtol=0.01)


def test_bins_are_equal_intervals_of_the_first_principal_component():
    rng = np.random.default_rng(2)
    landmarks = rng.normal(size=(500, 7, 3)) * rng.uniform(0.1, 3, size=(7, 3))
    bins = sampling.balance_bins(landmarks, 16)
    score = PCA(1).fit_transform(landmarks.reshape(500, -1))[:, 0]
    expected = np.clip((score - score.min()) / np.ptp(score) * 16, None, 15.999).astype(int)
    assert np.array_equal(bins, expected) or np.array_equal(15 - bins, expected)


def test_still_landmarks_share_one_bin():
    assert not sampling.balance_bins(np.ones((10, 4, 3)), 16).any()


def test_balanced_draws_are_uniform_over_bins_and_within_them():
    bins = np.array([3] * 900 + [7] * 90 + [15] * 10, dtype=np.int16)
    indices = sampling.draw_from_index(*sampling.bin_index(bins), 30_000, np.random.default_rng(0))
    share = np.bincount(bins[indices], minlength=16) / 30_000
    assert np.allclose(share[[3, 7, 15]], 1 / 3, atol=0.02)
    rare = np.bincount(indices, minlength=1000)[990:]
    assert rare.min() > 850 and rare.max() < 1_150


def test_held_out_poses_occur_once_and_leave_the_training_part():
    single, duplicates = np.arange(120, dtype=np.float32)[:, None], np.full((40, 1), -1, dtype=np.float32)
    poses = np.concatenate([single, duplicates])[np.random.default_rng(7).permutation(160)]
    rest, holdout = sampling.hold_out(poses, 8, np.random.default_rng(1))
    assert len(holdout) == 8 and holdout.min() >= 0
    assert rows(rest) | rows(holdout) == rows(poses) and not rows(rest) & rows(holdout)
    assert len(sampling.hold_out(poses, 1_000, np.random.default_rng(1))[1]) == 12  # a tenth of the single ones


def test_no_pose_that_occurs_twice_is_held_out():
    poses = np.concatenate([np.arange(8), np.arange(6)]).astype(np.float32)[:, None]  # 6 and 7 occur once
    held_out = [sampling.hold_out(poses, 1, np.random.default_rng(seed))[1].item() for seed in range(20)]
    assert set(held_out) == {6.0, 7.0}


def test_an_animation_that_repeats_every_pose_has_none_to_hold_out():
    with pytest.raises(InputError, match="more than once"):
        sampling.hold_out(np.zeros((9, 2), np.float32), 3, np.random.default_rng(0))
