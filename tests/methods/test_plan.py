"""A plan has each stage once; keys change with what numbers depend on, not with what labels or arranges them."""

from dataclasses import replace

import pytest
from outside import WITH_MODEL, bring  # noqa: F401, a fixture

from replicate.cli.target_list import targets
from replicate.config import resolve
from replicate.engine.stage import in_order
from replicate.methods import artefacts, measurement
from replicate.methods.linear import LinearConfig
from replicate.methods.method_registry import choose, methods
from replicate.methods.plan import Plan

SHOWN = {"ranked-tiny", "typical_mine-tiny", "table2-tiny"}  # what shows a method that ranks the poses


def plan(**overrides) -> Plan:
    return Plan(resolve("tiny", "quick", overrides))


def keys(selection, **overrides) -> dict[str, str]:
    """Return the keys of Table 2's stages for some methods, by their titles."""
    return {stage.title: stage.key for stage in in_order(targets()["table2"].stages(plan(**overrides), selection))}


def differences(before: dict[str, str], after: dict[str, str]) -> set[str]:
    assert set(before) == set(after)
    return {title for title in before if before[title] != after[title]}


def test_a_stage_is_put_together_once_whoever_asks_for_it():
    one, selection = plan(), choose(["coarse", "refined", "pca", "lbs32", "driven"])
    stages = [stage for target in targets().values() if target.stages for stage in target.stages(one, selection)]
    by_title = {}
    for stage in in_order(stages):
        assert by_title.setdefault(stage.title, stage) is stage, "two stages of one name"
    assert artefacts.rig_stage(one) is artefacts.rig_stage(one) is not artefacts.rig_stage(plan())


def test_equal_numbers_are_equal_configurations_of_the_same_keys():
    section = {"mine": LinearConfig()}
    one, other = (resolve("tiny", "quick", sections=section) for _ in range(2))
    assert one == other != resolve("tiny", "quick", {"mine": {"strengths": [1.0]}}, sections=section)
    assert resolve("tiny", "quick") == resolve("tiny", "quick")


def test_all_seeds_share_the_rig_and_no_samples():
    one, other = (Plan(resolve("tiny", "quick", seed=seed)) for seed in (0, 3))
    assert artefacts.rig_stage(one).key == artefacts.rig_stage(other).key
    first, second = artefacts.samples_stage(one), artefacts.samples_stage(other)
    assert first.key != second.key and (first.title, second.title) == ("samples-tiny", "samples-tiny-seed3")


def test_labels_notes_and_colours_of_the_projects_methods_change_no_key():
    before = [measurement.stage(plan(), method) for method in methods().values()]
    for stage, method in zip(before, methods().values(), strict=True):
        other = replace(method, label="X", note="Other words.", mark="*", colour="#000000", place=1.0, in_figures=False)
        assert measurement.stage(plan(), other).key == stage.key


def test_a_methods_own_numbers_change_the_stages_that_read_them_and_what_follows():
    before = keys(choose(["coarse", "dense", "neutral"]))
    after = keys(choose(["coarse", "dense", "neutral"]), dense={"hidden": [8, 8]})
    assert differences(before, after) == {"dense-tiny", "errors_dense-tiny", "typical_dense-tiny", "table2-tiny"}


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('"Mean pose"', '"Average pose"', set()),
        ("The mean pose.", "The pose in the middle.", set()),
        ("#123456", "#654321", set()),
        ("plan.settings(None), artefacts.rig_stage(plan)", "plan.settings(None), *[artefacts.rig_stage(plan)]", set()),
        ("def load(inputs, settings):\n", 'def load(inputs, settings):\n    """Say what it returns."""\n', set()),
        ("neutral + np.load", "neutral - np.load", SHOWN | {"errors_mine-tiny"}),
        ("np.arange(2)", "np.arange(3)", SHOWN | {"mine-tiny", "errors_mine-tiny"}),
    ],
)
def test_only_what_a_method_computes_changes_its_keys(bring, old, new, expected):  # noqa: F811
    before = keys(choose([str(bring()), "neutral"]))
    after = keys(choose([str(bring((old, new))), "neutral"]))
    assert differences(before, after) == expected


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('"The mean pose\'s."', '"The middle\'s."', set()),
        ("inputs):\n    return", "inputs):\n    # what moves on average\n    return", set()),
        ("return Mean(", "return Mean(1.5 * ", SHOWN | {"errors_mine-tiny"}),
        ("return np.broadcast_to", "return 2 * np.broadcast_to", SHOWN | {"errors_mine-tiny"}),
    ],
)
def test_what_a_methods_model_computes_changes_its_keys(bring, old, new, expected):  # noqa: F811
    before = keys(choose([str(bring(text=WITH_MODEL)), "neutral"]))
    after = keys(choose([str(bring((old, new), text=WITH_MODEL)), "neutral"]))
    assert differences(before, after) == expected
