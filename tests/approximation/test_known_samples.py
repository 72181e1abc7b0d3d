"""Parts of the poses of a rig that is known by its samples: nothing of what is held out is trained on."""

import numpy as np
import pytest

from data_recipes.rig import Clip, KnownPoses
from replicate.approximation.samples import choose_known
from replicate.config import SamplesConfig
from replicate.engine.stage import stream_rng

M = 3


def known(frames=100, drawn=200, source=True):
    """Return known poses, and the clips that their frames are."""
    generator = np.random.default_rng(0)
    acted = generator.uniform(0.1, 1, (frames, M)).astype(np.float32)
    of = generator.integers(frames, size=drawn)
    params = (acted[of] * generator.uniform(0.25, 3, (drawn, M))).astype(np.float32)
    nothing = np.zeros((0, 1, 3), np.float32)
    poses = KnownPoses(acted, nothing, params, nothing, np.zeros(drawn), of if source else np.full(drawn, -1))
    return poses, tuple(Clip(f"clip {k}", part) for k, part in enumerate(np.split(acted, 5)))


def parts(poses, clips, **numbers):
    """Return the poses by part."""
    config = SamplesConfig(**{"count": 1000, "validation": 5, **numbers})
    return choose_known(poses, clips, config, lambda stream: stream_rng(0, "samples", stream))


def rows(poses):
    """Return poses as a set."""
    return {pose.tobytes() for pose in poses}


@pytest.mark.parametrize("split", ["frames", "clips"])
def test_no_training_pose_is_drawn_from_a_frame_that_is_held_out(split):
    poses, clips = known()
    found = parts(poses, clips, split=split)
    held_out = rows(found["test"]) | rows(found["validation"])
    assert len(held_out) == len(found["test"]) + 5 and not held_out & rows(found["training"])
    sources = poses.frame_params[poses.drawn_source]
    left_out = [pose for pose, source in zip(poses.drawn_params, sources, strict=True) if source.tobytes() in held_out]
    assert left_out and not rows(left_out) & rows(found["training"])
    assert len(found["training"]) == 200 - len(left_out) + 100 - len(held_out)  # training frames fill up


def test_frames_do_not_join_where_enough_poses_are_drawn():
    poses, clips = known()
    training = parts(poses, clips, count=250)["training"]
    assert len(training) < 200 and not rows(training) & rows(poses.frame_params)


def test_whole_clips_are_held_out():
    poses, clips = known()
    test = rows(parts(poses, clips, split="clips")["test"])
    assert any(rows(clip.values) == test for clip in clips)


def test_a_pose_of_unknown_source_is_trained_on():
    poses, clips = known(source=False)
    assert len(rows(poses.drawn_params) & rows(parts(poses, clips)["training"])) == 200


def test_a_profile_that_asks_for_fewer_gets_fewer_and_no_frames():
    poses, clips = known()
    training = parts(poses, clips, count=50)["training"]
    assert len(training) == 50 and rows(training) <= rows(poses.drawn_params)


def test_without_clips_all_poses_are_split():
    poses, _ = known(drawn=0)
    found = parts(poses, None, uniform_test=7)
    assert len(found["test"]) == 7 and len(found["training"]) == 100 - 10 - 5
    assert not (rows(found["test"]) | rows(found["validation"])) & rows(found["training"])
