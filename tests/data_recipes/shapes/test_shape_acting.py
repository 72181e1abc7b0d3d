"""Acting for faces without animation: few controls at a time, all of them some time, opposites apart."""

import numpy as np
from shape_faces import ARKIT

from data_recipes.acting.arkit_names import canonical
from data_recipes.acting.procedural_acting import Acting
from data_recipes.controls import Control
from data_recipes.shapes.control_names import mirrored_pairs, opposite, region_of_control, side_of
from data_recipes.shapes.shape_acting import act_shapes, sparse_pose

NAMES = ("lipCornerUp_L", "lipCornerUp_R", "lipCornerDown_L", "lipCornerDown_R", "mouthLeft", "mouthRight", "snarl")


def controls(names):
    return [Control(name, 0.0, 0.0, 1.0, "face") for name in names]


def test_names_of_several_programs_mean_the_same():
    same = ("eyeBlinkLeft", "EyeBlink_L", "head.eye_blink_left", "eyeBlink_L", "Face.M_F00_000_00_Fcl_EYE_Close_L")
    assert {canonical(name) for name in same} == {"eyeBlink_L"}
    assert canonical("browInnerUp") == "browInnerUp" and canonical("viseme_aa") == "viseme_aa"


def test_left_is_a_side_of_a_brow_and_a_direction_of_a_jaw():
    assert side_of("browDown_L") == ("browDown_*", "left") and side_of("l_brow") == ("*_brow", "left")
    assert side_of("jawLeft") == ("jawLeft", "") and side_of("smile") == ("smile", "")
    assert mirrored_pairs(["jawLeft", "jawRight", "eyeBlinkLeft", "eyeBlinkRight"]) == [(0,), (1,), (2, 3)]


def test_opposites_differ_by_one_word():
    assert opposite("jawLeft", "jawRight") and opposite("eyeLookUp_L", "eyeLookDown_L")
    assert not opposite("jawLeft", "jawOpen") and not opposite("mouthUpperUp_L", "mouthLowerDown_L")


def test_a_control_belongs_to_the_region_that_its_name_speaks_of():
    assert [region_of_control(name) for name in ("browDown_L", "eyeBlinkLeft", "jawOpen", "viseme_aa", "x")] == [
        "brows", "eye_left", "jaw", "mouth", "face"
    ]  # fmt: skip


def test_our_own_acting_plays_on_arkits_names_and_every_control_moves():
    clips = act_shapes(controls(ARKIT), Acting(clips=12))
    frames = np.concatenate([values for _, values in clips])
    assert len(clips) == 12 and frames.min() >= 0 and frames.max() <= 1
    assert (np.ptp(frames, axis=0) > 0.1).all(), "tongueOut too, which our acting doesn't know"
    assert any("gestures" in name for name, _ in clips) and any("emotion" in name for name, _ in clips)


def test_a_face_whose_names_say_nothing_moves_few_controls_at_a_time():
    names = [f"shape_{k:02d}" for k in range(40)]
    clips = act_shapes(controls(names), Acting(clips=30, clip_s=6.0))
    frames = np.concatenate([values for _, values in clips])
    active = (frames > 0.02).sum(axis=1)
    assert np.median(active) <= 5 and active.max() <= 10
    assert (np.ptp(frames, axis=0) > 0.2).all()


def test_opposites_are_not_set_at_once_and_pairs_mostly_are():
    rng = np.random.default_rng(0)
    listed = controls(NAMES)
    pairs = mirrored_pairs(NAMES)
    poses = np.stack([sparse_pose(listed, pairs, 1.0, rng) for _ in range(400)])
    up, down = poses[:, 0] > 0, poses[:, 2] > 0
    assert not (up & down).any() and not ((poses[:, 4] > 0) & (poses[:, 5] > 0)).any()
    both = (poses[:, 0] > 0) & (poses[:, 1] > 0)
    assert 0.5 < both.sum() / up.sum() < 0.95


def test_the_same_settings_give_the_same_clips():
    first, second = (act_shapes(controls(ARKIT), Acting(clips=3)) for _ in range(2))
    assert all((a[1] == b[1]).all() for a, b in zip(first, second, strict=True))
