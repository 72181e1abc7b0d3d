"""Rigid clusters of a mesh whose rigid parts are known."""

import numpy as np

from replicate.baselines.skinning.clusters import cluster, cluster_errors, refill, split
from replicate.baselines.skinning.compression import compress
from replicate.geometry.alignment import nearest_rotation


def parts(count=4, size=30, poses=12, seed=0):
    """Boxes of points beside one another, each of which moves rigidly on its own."""
    rng = np.random.default_rng(seed)
    boxes = [rng.uniform(-8, 8, (size, 3)) + np.array([25 * k, 0, 0]) for k in range(count)]
    turns = nearest_rotation(np.eye(3) + 0.3 * rng.normal(size=(count, poses, 3, 3)))
    moved = [box @ turn + rng.normal(size=(poses, 1, 3)) * 4 for box, turn in zip(boxes, turns, strict=True)]
    return np.concatenate(boxes).astype(np.float32), np.concatenate(moved, 1).astype(np.float32)


def test_each_rigid_part_becomes_a_cluster_that_fits_it():
    neutral, poses = parts()
    data = compress(neutral, poses, np.random.default_rng(0))
    labels, motion = cluster(data, 4)
    groups = labels.reshape(4, 30)
    assert (groups == groups[:, :1]).all() and sorted(groups[:, 0]) == [0, 1, 2, 3]
    errors = cluster_errors(data, motion)
    own = np.take_along_axis(errors, labels[:, None], 1)
    assert own.max() < 1e-8 and np.sort(errors, 1)[:, 1].min() > 1e-3


def test_errors_are_those_of_the_moved_points():
    neutral, poses = parts()
    data = compress(neutral, poses, np.random.default_rng(0))
    _, motion = cluster(data, 3)
    predicted = np.einsum("fkbp,np->nbfk", motion, data.points).reshape(len(neutral), 3, -1)
    target = data.basis @ data.coefficients
    expected = ((predicted - target.T[:, None]) ** 2).sum(-1)
    np.testing.assert_allclose(cluster_errors(data, motion), expected, rtol=1e-6, atol=1e-9)


def test_a_split_takes_the_far_and_badly_fitted_side_of_the_worst_cluster():
    rest = np.zeros((20, 3))
    rest[:, 0] = np.arange(20)
    labels = np.repeat([0, 1], 10)
    error = np.where(np.arange(20) == 19, 5.0, 0.1)
    after, left = split(rest, labels, error)
    assert after[19] == 2 and after[10] == 1 and (after[:10] == 0).all()
    assert not left[10:].any() and (left[:10] == 0.1).all()
    again, _ = split(rest, after, left)
    assert set(again[:10]) == {0, 3}


def test_an_empty_cluster_is_refilled_with_the_worst_fitted_vertices_of_another():
    rest = np.zeros((40, 3))
    rest[:, 0] = np.arange(40)
    errors = np.ones((40, 3))
    errors[33, 1] = 9.0
    labels = refill(rest, np.repeat([0, 1], 20), errors, 3)
    assert labels[33] == 2 and (labels == 2).sum() == 6 and (labels[:20] == 0).all()
