"""ARKit's names for controls, and weights of its shapes on rigs that spell them in their own way."""

import numpy as np
import pytest

from data_recipes.acting.arkit_names import arkit_parts, play_weights, without_counterpart
from data_recipes.controls import Control, control_groups

SHAPES = ("EyeBlinkLeft", "EyeBlinkRight", "JawOpen", "CheekPuff", "MouthLeft", "MouthRight", "TongueOut")


def played(controls, limits=(0.0, 0.0, 1.0), **weights):
    """Return what controls get, by name, where they move, and the shapes without a counterpart."""
    values = np.array([[weights.get(name, 0.0) for name in SHAPES]])
    rig = [Control(name, *limits, "face") for name in controls]
    params, lacking = play_weights(SHAPES, values, rig)
    assert lacking == without_counterpart(SHAPES, controls)
    moved = {name: value for name, value in zip(controls, params[0], strict=True) if value != limits[1]}
    return moved, lacking


@pytest.mark.parametrize(
    "spelt",
    ["eyeBlinkLeft", "eyeBlink_L", "EyeBlinkLeft", "head.eye_blink_left", "Fcl_EYE_Close_L", "eye-left-closure"],
)
def test_a_weight_drives_the_control_of_its_name_however_that_is_spelt(spelt):
    moved, lacking = played([spelt, "other"], EyeBlinkLeft=0.4, JawOpen=1.0)
    assert moved == {spelt: 0.4} and lacking == list(SHAPES[1:])


def test_one_shape_for_both_sides_drives_both_and_two_shapes_one_control_by_their_mean():
    assert played(["cheekPuff_L", "cheekPuff_R"], CheekPuff=0.5)[0] == {"cheekPuff_L": 0.5, "cheekPuff_R": 0.5}
    assert played(["cheekPuff"], CheekPuff=0.5)[0] == {"cheekPuff": 0.5}
    assert played(["eyeBlink"], EyeBlinkLeft=1.0)[0] == {"eyeBlink": 0.5}


def test_of_two_controls_that_mean_the_same_one_is_driven():
    assert played(["eyeBlinkLeft", "blink_l", "eyeBlink"], EyeBlinkLeft=0.5)[0] == {"eyeBlinkLeft": 0.5}


def test_weights_stay_within_the_limits_and_reach_those_that_count_otherwise():
    assert played(["jawOpen"], JawOpen=1.2)[0] == {"jawOpen": 1.0}
    assert played(["jawOpen"], (0.0, 0.0, 100.0), JawOpen=0.3)[0] == {"jawOpen": pytest.approx(30.0)}


def test_our_own_controls_stand_for_shapes_too():
    ours = [control.name for group in control_groups().values() for control in group]
    moved, lacking = played(ours, (-1.0, 0.0, 1.0), EyeBlinkLeft=0.5, CheekPuff=0.5, MouthRight=0.35)
    assert moved == {
        "blink_left": 0.5,
        "cheek_puff_left": 0.5,
        "cheek_puff_right": 0.5,
        "mouth_sideways": pytest.approx(-0.5),
    }
    assert lacking == []


def test_names_that_are_not_arkits_have_no_parts():
    assert arkit_parts("HeadYaw") == () and arkit_parts("smirk") == ()
    assert arkit_parts("browInnerUp") == ("browInnerUp_L", "browInnerUp_R") and arkit_parts("TongueOut") == (
        "tongueOut",
    )
