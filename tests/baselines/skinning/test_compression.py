"""The low-rank factorisation of poses, and the order that it is made in."""

import numpy as np

from replicate.baselines.skinning import compression as lbs_compression
from replicate.baselines.skinning.compression import canonical_order, compress


def low_rank(rank=5, poses=20, n=80, seed=0):
    rng = np.random.default_rng(seed)
    neutral = rng.normal(size=(n, 3)).astype(np.float32) * 50 + np.float32([5, -3, 100])
    offsets = rng.normal(size=(3 * poses, rank)) @ rng.normal(size=(rank, n))
    return neutral, (neutral + offsets.reshape(poses, 3, n).transpose(0, 2, 1)).astype(np.float32)


def restored_mm(data, neutral):
    moved = (data.basis @ data.coefficients).reshape(data.frames, 3, -1).transpose(0, 2, 1)
    return neutral + data.radius_mm * moved


def test_poses_come_back_from_their_factors_at_the_rank_that_they_have():
    neutral, poses = low_rank()
    data = compress(neutral, poses, np.random.default_rng(0))
    assert data.basis.shape == (60, 5) and data.frames == 20
    np.testing.assert_allclose(data.basis.T @ data.basis, np.eye(5), atol=1e-12)
    np.testing.assert_allclose(restored_mm(data, neutral), poses, atol=1e-3)
    np.testing.assert_allclose(data.points[:, :3] * data.radius_mm + data.centre_mm, neutral, atol=1e-5)
    assert np.isclose((data.points[:, :3] ** 2).sum(1).mean(), 1) and data.lost <= lbs_compression.TOLERANCE


def test_the_rank_is_doubled_until_little_is_left_out(monkeypatch):
    monkeypatch.setattr(lbs_compression, "FIRST_RANK", 4)
    neutral, poses = low_rank(rank=13)
    assert compress(neutral, poses, np.random.default_rng(0)).basis.shape[1] == 13
    monkeypatch.setattr(lbs_compression, "LARGEST_RANK", 8)
    data = compress(neutral, poses, np.random.default_rng(0))
    assert data.basis.shape[1] == 8 and 0.05 < data.lost < 0.8


def test_still_poses_compress_to_zero():
    neutral, _ = low_rank()
    data = compress(neutral, np.repeat(neutral[None], 3, 0), np.random.default_rng(0))
    assert not data.coefficients.any() and data.lost == 0


def test_the_canonical_order_sees_contents_and_not_positions():
    neutral, poses = low_rank()
    neutral[7] = neutral[3]  # told apart by their motion
    rng = np.random.default_rng(1)
    vertex, pose = rng.permutation(80), rng.permutation(20)
    first, second = canonical_order(neutral, poses)
    mixed, shuffled = canonical_order(neutral[vertex], poses[pose][:, vertex])
    np.testing.assert_array_equal(vertex[mixed], first)
    np.testing.assert_array_equal(pose[shuffled], second)
    assert sorted(first) == list(range(80)) and sorted(second) == list(range(20))
