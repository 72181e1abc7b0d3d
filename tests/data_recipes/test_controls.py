"""Controls: names, counts, ranges, and what a bad recipe hears."""

import re
from dataclasses import asdict

import pytest

from data_recipes.controls import Control, control_groups, control_index, handle_names, limit_controls, make_controls
from data_recipes.recipe.reading import load_recipe
from replicate.base.exceptions import InputError

ALL = {group: len(controls) for group, controls in control_groups().items()}


def test_every_control_has_a_plain_name_of_its_own():
    controls = make_controls(ALL)
    assert len({c.name for c in controls}) == len(controls)
    assert all(re.fullmatch(r"[a-z][a-z0-9_]*", c.name) for c in controls)


@pytest.mark.parametrize("name, count", [("teen", 258), ("woman", 265), ("dragon", 286), ("toon", 99)])
def test_a_recipe_has_as_many_controls_as_the_character_it_stands_for(name, count):
    assert len(make_controls(asdict(load_recipe(name).controls))) == count


def test_the_dragon_has_every_control_of_the_teen_and_then_those_of_a_creature():
    teen, dragon = (make_controls(asdict(load_recipe(name).controls)) for name in ("teen", "dragon"))
    assert dragon[:258] == teen
    assert list(dragon[258:]) == control_groups()["creature"]


def test_the_woman_has_every_control_of_the_teen_and_seven_more():
    teen, woman = (make_controls(asdict(load_recipe(name).controls)) for name in ("teen", "woman"))
    more = [control.name for control in woman if control not in teen]
    assert [control for control in woman if control in teen] == list(teen)
    assert len(more) == 7 and {"nose_sideways", "neck_tendon_left", "follow_aside_right"} < set(more)


def test_every_default_is_zero_and_inside_its_range():
    assert all(c.lower <= c.default == 0 <= c.upper for c in make_controls(ALL))


def test_each_left_control_has_a_right_twin_of_the_same_range():
    by_name = {c.name: c for c in make_controls(ALL)}
    lefts = [c for c in by_name.values() if "left" in c.name]
    assert len(lefts) > 80
    for left in lefts:
        right = by_name[left.name.replace("left", "right")]
        assert (right.lower, right.upper) == (left.lower, left.upper)
        assert right.region == left.region.replace("left", "right")


def test_a_smaller_rig_takes_the_first_controls_of_each_group():
    small = make_controls({"face": 4, "jaw": 1, "handles": 6})
    assert [c.name for c in small][:5] == [
        "brow_inner_up_left", "brow_inner_up_right", "brow_outer_up_left", "brow_outer_up_right", "jaw_open",
    ]  # fmt: skip
    assert handle_names(small) == ["brow_left_02", "brow_right_02"]
    assert control_index(small)["jaw_open"] == 4


def test_a_reach_draws_the_limits_in_and_leaves_those_named_full():
    controls = make_controls({"face": 12, "jaw": 2})
    by_name = {c.name: c for c in limit_controls(controls, 0.5, ["blink_*"])}
    assert (by_name["smile_left"].lower, by_name["smile_left"].upper) == (0.0, 0.5)
    assert (by_name["jaw_sideways"].lower, by_name["jaw_sideways"].upper) == (-0.5, 0.5)
    assert by_name["blink_left"].upper == by_name["blink_right"].upper == 1
    assert limit_controls(controls, 1.0, []) == controls
    with pytest.raises(InputError, match=r"toon\.toml: limits\.full names 'wink_left'"):
        limit_controls(controls, 0.5, ["wink_*"], "toon.toml")


@pytest.mark.parametrize(
    "counts, part",
    [
        ({"whiskers": 3}, "controls: there is no group 'whiskers'; there are face, jaw, "),
        ({"face": 58}, "controls.face: expected a whole number from 0 to 57, got 58"),
        ({"jaw": -1}, "controls.jaw: expected a whole number from 0 to 16, got -1"),
        ({"jaw": 2.5}, "controls.jaw: expected a whole number from 0 to 16, got 2.5"),
        ({"jaw": True}, "controls.jaw: expected a whole number from 0 to 16, got True"),
        ({}, "at least one control"),
    ],
)
def test_bad_counts_are_named(counts, part):
    with pytest.raises(InputError, match=re.escape(part)) as error:
        make_controls(counts, "teen.toml")
    assert str(error.value).startswith("teen.toml")


@pytest.mark.parametrize(
    "numbers, part",
    [
        ((1.0, 1.0, 1.0), "empty"),
        ((2.0, 0.0, -2.0), "empty"),
        ((0.0, 2.0, 1.0), "outside"),
        ((0.0, 0.0, float("nan")), "finite"),
    ],
)
def test_a_control_with_an_empty_range_or_no_number_is_refused(numbers, part):
    with pytest.raises(InputError, match=part) as error:
        Control("jaw_open", *numbers, "jaw")
    assert "'jaw_open'" in str(error.value)
