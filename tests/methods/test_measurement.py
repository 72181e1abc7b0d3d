"""The measurement of a method: the truth is handed to oracles alone, rigid segments are placed, and all is kept."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import toy_methods
from small_artefacts import SHOWN_POSE, run_stage, write_artefacts
from small_face import small_mesh
from toy_methods import BLIND

from replicate.base.exceptions import RunError
from replicate.config import resolve
from replicate.methods import artefacts, measurement
from replicate.methods.measurement import predictor
from replicate.methods.method_registry import methods
from replicate.methods.plan import Plan, reference


@pytest.fixture
def inputs(tmp_path):
    return write_artefacts(tmp_path)


def test_a_method_that_is_no_oracle_is_never_handed_the_truth(inputs):
    params, mesh = np.float32([[1] * 12, [-2] * 12]), small_mesh()
    truth = np.zeros((2, *mesh.neutral.shape), np.float32)
    predicted = predictor(BLIND, inputs)(params, truth)
    np.testing.assert_array_equal(predicted, predictor(BLIND, inputs)(params, truth + 5))
    moved = np.broadcast_to(2 * params[:, :1, None] * np.float32([1, 0, 0]), truth.shape)
    np.testing.assert_allclose(predicted - mesh.neutral, moved, atol=1e-5)
    seeing = replace(BLIND, load=reference(toy_methods.seeing), oracle=True)
    np.testing.assert_array_equal(
        predictor(seeing, inputs)(params, truth + 5) - truth, 5 + np.float32([2, 0, 0]) + truth
    )
    with pytest.raises(TypeError, match="truth"):
        predictor(replace(seeing, oracle=False), inputs)(params, truth)


@pytest.mark.parametrize("method", methods().values(), ids=lambda method: method.name)
def test_the_stage_of_a_registered_method_knows_whether_it_is_an_oracle_and_attached(method):
    stage = measurement.stage(Plan(resolve("tiny", "quick")), method)
    assert (stage.config.oracle, stage.config.rigid_step) == (method.oracle, method.rigid_step)
    code = [measurement.measure, *filter(None, (method.load, method.model, method.facts, method.multiplications))]
    assert set(map(reference, code)) <= set(stage.function.split(", ")), "what they compute decides the key"
    assert {"rig", "samples", "wrinkled", "rigid", "waves"} <= {source.name for source in stage.inputs}


def test_rigid_segments_are_placed_by_their_attachments_where_the_method_wants_it(inputs):
    params, mesh = np.ones((2, 12), np.float32), small_mesh()
    truth = np.broadcast_to(mesh.neutral, (2, *mesh.neutral.shape))
    attached = predictor(replace(BLIND, rigid_step=True), inputs)(params, truth)
    plain = predictor(BLIND, inputs)(params, truth)
    rigid = np.isin(mesh.segment, artefacts.load_attachments(inputs).segment)
    assert rigid.any()
    np.testing.assert_array_equal(attached[:, ~rigid], plain[:, ~rigid])
    np.testing.assert_allclose(attached[:, rigid], plain[:, rigid], atol=1e-3)  # all moves as one
    seeing = replace(BLIND, load=reference(toy_methods.seeing), oracle=True, rigid_step=True, settings=0.0)
    torn = truth.copy()
    torn[:, rigid] += 50
    np.testing.assert_allclose(predictor(seeing, inputs)(params, torn), truth, atol=1e-3)


@pytest.mark.parametrize("answer", toy_methods.ANSWERS)
@pytest.mark.parametrize("rigid_step", [False, True])
def test_a_prediction_is_real_finite_and_of_the_meshs_shape_or_its_method_is_named(inputs, answer, rigid_step):
    settings = replace(BLIND, load=reference(toy_methods.mistaken), settings=answer, rigid_step=rigid_step)
    params, truth = np.zeros((2, 12), np.float32), np.zeros((2, 0, 3), np.float32)
    if answer in toy_methods.GOOD:
        assert predictor(settings, inputs)(params, truth).shape == (2, *small_mesh().neutral.shape)
        return
    shape = re.escape(f"(2, {len(small_mesh().neutral)}, 3)")
    with pytest.raises(RunError, match=f"^method toy: expected vertices {shape}, real and finite, got ") as error:
        predictor(settings, inputs)(params, truth)
    assert len(str(error.value)) < 300 and "\n" not in str(error.value)


def test_errors_pose_numbers_size_and_curve_are_kept(inputs, tmp_path):
    own = tmp_path / "toy"
    own.mkdir()
    (own / "manifest.json").write_text(json.dumps({"notes": {"size_mb": 1.5}}))
    (own / "log.csv").write_text("step,loss,mm,degrees\n100,3.5,1.25,4.5\n")
    inputs["toy"] = own
    work = reference(toy_methods.multiplications)
    settings = replace(BLIND, facts=reference(toy_methods.facts), test_poses=5, multiplications=work)
    folders, _ = run_stage(measurement.measure, inputs, "errors_toy", settings, tmp_path)
    folder, samples, mesh = folders["errors_toy"], artefacts.load_samples(inputs), small_mesh()
    assert measurement.error_folders(folders | {"errors_toy-small": folder}) == {"toy": folder}
    errors = measurement.load_errors(folder)
    assert len(errors.pose_mm) == 5
    moved = mesh.neutral + 2 * samples.test_params[SHOWN_POSE, 0] * np.float32([1, 0, 0])
    np.testing.assert_allclose(measurement.load_pose(folder), moved, atol=1e-5)
    truth = mesh.neutral + samples.test_offsets
    predicted = mesh.neutral + 2 * samples.test_params[:, :1, None] * np.float32([1, 0, 0])
    exact = np.linalg.norm(predicted - truth, axis=-1).mean(1)
    assert np.isclose(errors.pose_mm[:, None], exact, rtol=1e-4).any(1).all()
    n = len(mesh.neutral)
    metrics = measurement.load_metrics(folder)
    of_frequency = [name for name, _, _ in metrics if "frequency" in name]
    assert of_frequency[:3] == ["high_frequency_error_mean", "high_frequency_share", "frequency_band_0"]
    assert [metric for metric in metrics if metric[0] not in of_frequency] == [
        ("vertices", "count", n),
        ("multiplications", "count", 3 * n),
        ("model_size", "MB", 1.5),
    ]
    assert measurement.load_curve(folder).read_text() == (own / "log.csv").read_text()


def test_fewer_poses_are_some_of_the_more(inputs, tmp_path):
    subsets = []
    for count in (4, 9):
        folders, _ = run_stage(
            measurement.measure, inputs, f"errors_{count}", replace(BLIND, test_poses=count), tmp_path
        )
        subsets.append(set(measurement.load_errors(folders[f"errors_{count}"]).pose_mm.tolist()))
    assert subsets[0] < subsets[1] and len(subsets[1]) == 9
