"""The library of expressions and visemes speaks of controls that exist, within their limits."""

import pytest

from data_recipes.acting.antics import CREATURE
from data_recipes.acting.expressions import EXPRESSIONS, MARK, expression
from data_recipes.acting.speech import VISEMES
from data_recipes.controls import control_groups

CONTROLS = {control.name: control for group in control_groups().values() for control in group}


@pytest.mark.parametrize("name,amounts", [*EXPRESSIONS.items(), *VISEMES.items()])
def test_amounts_name_real_controls_and_keep_their_limits(name, amounts):
    for stem, amount in amounts.items():
        for side in ("left", "right") if "*" in stem else ("",):
            control = CONTROLS[stem.replace("*", side)]
            assert control.lower <= amount <= control.upper, stem
            assert amount != 0, stem


def test_expressions_and_visemes_are_all_different():
    for library in (EXPRESSIONS, VISEMES):
        assert len({tuple(sorted(amounts.items())) for amounts in library.values()}) == len(library)


@pytest.mark.parametrize("name,amounts", CREATURE.items())
def test_what_a_creature_does_otherwise_names_real_controls_and_keeps_their_limits(name, amounts):
    assert name in EXPRESSIONS
    for stem, amount in amounts.items():
        for side in ("left", "right") if "*" in stem else ("",):
            control = CONTROLS[stem.replace("*", side)]
            assert control.lower <= amount <= control.upper, stem


def test_only_a_rig_with_a_creatures_controls_acts_like_one():
    assert expression("anger", {"smile_left"}) == EXPRESSIONS["anger"]
    anger = expression("anger", {"smile_left", MARK})
    assert anger["snarl_*"] > 0.5 and anger["chin_raise"] == 0
    assert anger["brow_squeeze_*"] == EXPRESSIONS["anger"]["brow_squeeze_*"]
    assert MARK in CONTROLS


# What each feeling is made of (Ekman & Friesen's action units, EMFACS), and what of other feelings it must not have.
ACTION_UNITS = {
    "joy": ({"cheek_raise_*": 0.9, "smile_*": 0.9}, ("brow_inner_up_*", "brow_down_*", "frown_*")),  # 6 + 12
    "sadness": (  # 1 + 4 + 15 + 17
        {"brow_inner_up_*": 0.9, "brow_squeeze_*": 0.3, "frown_*": 0.5, "chin_raise": 0.3},
        ("brow_outer_up_*", "eye_wide_*", "smile_*"),
    ),
    "surprise": (  # 1 + 2 + 5 + 26
        {"brow_inner_up_*": 0.9, "brow_outer_up_*": 0.6, "eye_wide_*": 0.6, "jaw_open": 0.4},
        ("brow_squeeze_*", "mouth_stretch_*"),
    ),
    "fear": (  # 1 + 2 + 4 + 5 + 7 + 20 + 26
        {
            "brow_inner_up_*": 0.9, "brow_outer_up_*": 0.3, "brow_squeeze_*": 0.9, "eye_wide_*": 0.9,
            "lid_lower_middle_*": 0.3, "mouth_stretch_*": 0.9, "jaw_open": 0.15,
        },
        ("smile_*", "funnel_*"),
    ),
    "anger": (  # 4 + 5 + 7 + 24
        {"brow_down_*": 0.9, "brow_squeeze_*": 0.8, "eye_wide_*": 0.2, "squint_*": 0.3, "lip_press_*": 0.5},
        ("brow_inner_up_*", "jaw_open"),
    ),
    "disgust": (  # 9 + 10 + 15 + 17
        {"nose_wrinkle_*": 1.0, "upper_lip_raise_left": 0.7, "frown_*": 0.7, "chin_raise": 0.5},
        ("smile_*", "eye_wide_*", "brow_outer_up_*"),
    ),
}  # fmt: skip


@pytest.mark.parametrize("feeling", ACTION_UNITS)
def test_a_feeling_is_made_of_its_action_units_and_of_no_other_feelings(feeling):
    amounts, (units, foreign) = EXPRESSIONS[feeling], ACTION_UNITS[feeling]
    for control, least in units.items():
        assert amounts.get(control, 0) >= least, control
    assert not set(foreign) & set(amounts)
