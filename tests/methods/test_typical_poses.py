"""The median and the worst test pose: by one rule, of the poses that were measured, predicted by each method."""

from dataclasses import replace

import numpy as np
import pytest
from small_artefacts import run_stage, write_artefacts
from small_face import small_mesh
from toy_methods import BLIND

from replicate.config import resolve
from replicate.methods import artefacts, measurement, typical_poses
from replicate.methods.method_registry import choose
from replicate.methods.plan import Plan
from replicate.methods.typical_poses import MEDIAN, WORST, KnownPoses, RankingSettings


@pytest.fixture
def inputs(tmp_path):
    return write_artefacts(tmp_path)


def ranked(inputs, tmp_path, test_poses=0):
    """Return the inputs with the errors of a toy method and the poses that they choose."""
    settings = replace(BLIND, test_poses=test_poses)
    inputs, _ = run_stage(measurement.measure, inputs, "errors_toy", settings, tmp_path)
    return run_stage(typical_poses.rank, inputs, "ranked", RankingSettings("toy", test_poses, 0), tmp_path)[0]


@pytest.mark.parametrize("test_poses", [0, 7])
def test_the_chosen_poses_are_the_median_and_the_worst_of_those_measured(inputs, tmp_path, test_poses):
    inputs = ranked(inputs, tmp_path, test_poses)
    errors = measurement.load_errors(inputs["errors_toy"]).pose_deg
    poses = measurement.measured_poses(artefacts.load_samples(inputs).test_params, test_poses, 0)
    method, chosen = typical_poses.load_chosen(inputs)
    of = dict(zip(poses.tolist(), errors.tolist(), strict=True))
    assert method == "toy" and of[chosen[WORST]] == errors.max()
    assert of[chosen[MEDIAN]] == np.sort(errors)[(len(errors) - 1) // 2]
    assert len(errors) == (test_poses or len(poses))


def test_a_method_predicts_both_poses(inputs, tmp_path):
    inputs = ranked(inputs, tmp_path)
    inputs, _ = run_stage(typical_poses.predict, inputs, "typical_toy", BLIND, tmp_path)
    samples, mesh = artefacts.load_samples(inputs), small_mesh()
    for choice, pose in typical_poses.load_chosen(inputs)[1].items():
        (name, predicted), *rest = typical_poses.load_predictions(inputs, choice).items()
        moved = mesh.neutral + 2 * samples.test_params[pose, 0] * np.float32([1, 0, 0])
        assert name == "toy" and not rest
        np.testing.assert_allclose(predicted, moved, atol=1e-5)


@pytest.mark.parametrize(
    ("names", "expected"),
    [(["dense", "refined", "coarse"], "refined"), (["dense", "coarse"], "coarse"), (["lbs16", "dense"], "dense")],
)
def test_refined_ranks_the_poses_else_coarse_else_the_first_of_the_table(names, expected):
    methods = choose(names)
    assert typical_poses.ranking_method(methods).name == expected
    ranking, *predictions = typical_poses.stages(Plan(resolve("tiny", "quick")), methods)
    assert ranking.config.method == expected
    assert {stage.name for stage in predictions} == {f"typical_{name}" for name in names}


def test_only_methods_that_figures_show_predict_the_poses():
    names = [stage.name for stage in typical_poses.stages(Plan(resolve("tiny", "quick")), choose(["coarse", "floor"]))]
    assert names == ["ranked", "typical_coarse"] and typical_poses.stages(Plan(resolve("tiny", "quick")), []) == []


def test_poses_that_are_known_are_taken_unless_the_method_that_ranked_them_is_there(inputs, tmp_path):
    plan, known = Plan(resolve("tiny", "quick")), KnownPoses("refined", median=3, worst=1)
    ranked, *predictions = typical_poses.stages(plan, choose(["dense"]), known)
    assert ranked.config == known and [stage.name for stage in predictions] == ["typical_dense"]
    assert not any(source.name.startswith("errors") for source in ranked.inputs)
    inputs, _ = run_stage(typical_poses.take, inputs, "ranked", known, tmp_path)
    assert typical_poses.load_chosen(inputs) == ("refined", {MEDIAN: 3, WORST: 1})
    anew = typical_poses.stages(Plan(resolve("tiny", "quick")), choose(["dense", "refined"]), known)[0]
    assert anew.config.method == "refined" and anew.name == "ranked"
