"""The library of expressions and visemes speaks of controls that exist, within their limits."""

import pytest

from data_recipes.acting.creature_acts import CREATURE
from data_recipes.acting.expressions import EXPRESSIONS, MARK, expression
from data_recipes.acting.visemes import VISEMES
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
