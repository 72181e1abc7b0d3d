"""A method is read through its model, or through functions of its own: what it predicts, and how much work that is."""

from dataclasses import replace

import numpy as np
import pytest
from outside import WITH_MODEL, bring  # noqa: F401, a fixture
from small_artefacts import predicted, run_stage, write_artefacts
from small_face import small_mesh

from replicate.base.exceptions import InputError, RunError
from replicate.base.schema import from_json, to_json
from replicate.config import resolve
from replicate.engine.stage import stage_function
from replicate.methods import artefacts, linear, measurement, neutral_pose
from replicate.methods.measurement import predictor, reading
from replicate.methods.method import Method
from replicate.methods.method_registry import choose
from replicate.methods.plan import Plan

CONFIG = resolve("tiny", "quick")


@pytest.fixture
def inputs(tmp_path, bring):  # noqa: F811
    """Artefacts with those of the mean pose, whose model predicts the mean of two samples' offsets; and its row."""
    (method,) = choose([str(bring(text=WITH_MODEL))])
    inputs = write_artefacts(tmp_path)
    (fit,) = method.stages(Plan(CONFIG))
    inputs, _ = run_stage(stage_function(fit.function), inputs, "mine", fit.config, tmp_path)
    return inputs, method


def test_what_a_model_adds_to_the_neutral_pose_is_predicted_and_its_own_count_is_its_work(inputs):
    inputs, method = inputs
    mean = artefacts.load_samples(inputs).offsets(np.arange(2)).mean(0)
    vertices = predicted(method, inputs, np.zeros((3, 12), np.float32))
    np.testing.assert_allclose(vertices, np.broadcast_to(small_mesh().neutral + mean, vertices.shape), atol=1e-5)
    read = reading(method, CONFIG)
    assert read.multiplications(inputs, read.settings) == 7


@pytest.mark.parametrize("answer", ["self.mean", "self.mean[:1]", "None", "np.zeros((len(params), 1, 3))", "0.0"])
def test_offsets_that_only_numpy_would_spread_over_the_mesh_are_refused_by_the_models_name(tmp_path, bring, answer):  # noqa: F811
    text = WITH_MODEL.replace("np.broadcast_to(self.mean, (len(params), *self.mean.shape))", answer)
    (method,) = choose([str(bring(text=text))])
    inputs = write_artefacts(tmp_path)
    (fit,) = method.stages(Plan(CONFIG))
    inputs, _ = run_stage(stage_function(fit.function), inputs, "mine", fit.config, tmp_path)
    with pytest.raises(RunError, match=r"^model brought_mine:read: expected offsets \(3, \d+, 3\), got "):
        predicted(method, inputs, np.zeros((3, 12), np.float32))


def test_another_process_finds_the_model_by_what_the_stage_says(inputs):
    inputs, method = inputs
    settings = from_json(to_json(measurement.stage(Plan(CONFIG), replace(method, rigid_step=False)).config))
    params, truth = np.zeros((2, 12), np.float32), np.zeros((2, 0, 3), np.float32)
    np.testing.assert_array_equal(predictor(settings, inputs)(params, truth), predicted(method, inputs, params))


def test_functions_of_a_method_without_a_model_are_called_as_they_are():
    read = reading(neutral_pose.METHOD, CONFIG)
    assert (read.load, read.multiplications) == (neutral_pose.load, neutral_pose.multiplications)
    assert read.settings is None and read.sources == (neutral_pose.load,)


def stages(plan):
    return ()


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({}, "method 'odd' has neither model nor load: give it one of the two"),
        (
            {"model": linear.load_model, "load": neutral_pose.load},
            "method 'odd' has both model and load: give it one of the two",
        ),
        (
            {"model": linear.load_model, "multiplications": neutral_pose.multiplications},
            "method 'odd' has a model, which is counted: leave its multiplications out",
        ),
    ],
)
def test_a_method_has_a_model_or_a_load_and_counts_its_work_in_one_way(fields, message):
    with pytest.raises(ValueError, match=message):
        Method("odd", "Odd", stages, **fields)


def test_a_file_from_outside_is_told_what_its_method_lacks(bring):  # noqa: F811
    file = bring(("model=read, ", ""), name="brought_bad", text=WITH_MODEL)
    with pytest.raises(InputError, match=r"brought_bad\.py: .*method 'mine' has neither model nor load"):
        choose([str(file)])
