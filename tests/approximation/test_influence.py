"""Which control moves what, on a stand-in whose controls hide at the default pose."""

from types import SimpleNamespace

import numpy as np
import pytest
import rigs
from plain_rig import PlainRig

from replicate.approximation.influence import THRESHOLD_MM, farthest_first, influence, influence_poses
from replicate.approximation.sampling import augment, sample_uniform, split_frames


class Hidden(PlainRig):
    """Vertex 0 follows control 0; vertex 1 control 1, only where 0 is raised; vertex 2 control 2, only downwards."""

    controls = ("open", "gain", "down", "idle")
    lower, default, upper = -np.ones(4, np.float32), np.zeros(4, np.float32), np.ones(4, np.float32)
    mesh = SimpleNamespace(neutral=np.zeros((4, 3), np.float32))

    def __call__(self, params):
        vertices = np.zeros((len(params), 4, 3), np.float32)
        vertices[:, 0, 0] = params[:, 0]
        vertices[:, 1, 1] = np.maximum(params[:, 0] - 0.5, 0) * params[:, 1]
        vertices[:, 2, 2] = np.minimum(params[:, 2], 0)
        vertices[:, 3, 0] = 5e-4 * params[:, 3]  # below the threshold
        return vertices


EXPECTED = np.array([[True, False, False, False], [True, True, False, False], [False, False, True, False], [False] * 4])


def animation():
    poses = np.zeros((50, 4), np.float32)
    poses[:, 0] = np.linspace(0, 0.9, 50)
    poses[10:20, 1] = 0.3
    return poses


def test_influence_is_found_at_poses_where_it_shows():
    rig = Hidden()
    assert np.array_equal(influence(rig, influence_poses(rig, animation(), np.random.default_rng(0))), EXPECTED)


def test_the_default_pose_alone_would_miss_some():
    moves = influence(Hidden(), np.zeros((1, 4), np.float32))
    assert not moves[1].any() and moves[0, 0] and moves[2, 2]


def test_the_threshold_decides_what_counts():
    assert influence(Hidden(), np.zeros((1, 4), np.float32), threshold_mm=1e-4)[3, 3]


@pytest.mark.parametrize("count", [3, 8, 12])
def test_poses_hold_the_default_and_far_apart_frames(count):
    poses = influence_poses(Hidden(), animation(), np.random.default_rng(0), count)
    assert len(poses) == count and not poses[0].any()
    assert poses[1, 0] == np.float32(0.9)


def test_farthest_first_spreads():
    points = np.array([[0.1, 0.0], [1.0, 0.0], [0.0, 0.9], [0.95, 0.1]])
    assert farthest_first(points, 2).tolist() == [1, 2]
    assert farthest_first(points, 9).tolist() == [1, 2, 3, 0]  # each point once


def test_no_influence_is_missed_on_other_poses_of_a_face():
    rig = rigs.rig("tiny")
    animation, test = split_frames([clip.values for clip in rig.clips], np.random.default_rng(0))
    moves = influence(rig, influence_poses(rig, animation, np.random.default_rng(1)))
    inputs = np.stack([moves[rig.mesh.segment == k].any(axis=0) for k in range(len(rig.mesh.segment_names))])
    assert inputs.any(axis=0).all() and inputs.mean() < 0.5  # every control does something, few segments feel most
    generator, m = np.random.default_rng(2), len(rig.controls)
    for pose in np.concatenate([augment(animation, 10, generator), test[::20]]):
        others = np.repeat(pose[None], m, axis=0)
        others[np.arange(m), np.arange(m)] = sample_uniform(rig.lower, rig.upper, 1, generator)[0]
        moved = np.abs(rig(others) - rig(pose)).max(axis=2)  # (m, n)
        missed = moved * ~inputs[rig.mesh.segment].T
        assert missed.max() < 5 * THRESHOLD_MM
