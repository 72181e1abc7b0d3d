"""The released code's recipe: its numbers, and that its networks train, load and predict like any other."""

from dataclasses import replace

import numpy as np
import pytest
from small_artefacts import predicted, run_stage, write_artefacts
from small_face import small_mesh

from replicate.base.schema import read_table
from replicate.config import ConditioningConfig, resolve
from replicate.methods import artefacts, dense_network, released
from replicate.methods.method_registry import method_named
from replicate.methods.plan import Plan, TrainingSettings
from replicate.report.results import read_log


@pytest.mark.parametrize("method", released.METHODS, ids=lambda method: method.name)
def test_each_row_has_the_released_numbers_and_the_steps_of_the_profile(method):
    section, usual = method.default_section("paper"), method.default_section("laptop").training.steps
    assert (section.training.batch, section.training.rates, section.training.shares) == (
        4,
        (1e-3, 1e-4, 1e-5),
        (5, 1, 1),
    )
    assert section.training.steps == 70_000 and usual < 70_000
    assert section.normal_weight == pytest.approx(750.0)
    assert section.conditioning == ConditioningConfig("released", 450.0, "released")


def test_only_the_width_is_read_differently_by_text_and_code():
    wide, narrow = (method_named(f"dense_released{end}").default_section("paper") for end in ("", "_narrow"))
    assert (wide.hidden, narrow.hidden) == ((256, 512), (256, 256)) and replace(wide, hidden=narrow.hidden) == narrow


def test_the_released_networks_are_not_those_of_the_suite():
    plan = Plan(resolve("tiny", "quick"))
    stages = {stage.name: stage for m in released.METHODS for stage in m.stages(plan)}
    assert set(stages) == {"coarse_released", "refined_released", "dense_released", "dense_released_narrow"}
    assert stages["refined_released"].inputs != method_named("refined").stages(plan)[-1].inputs


def test_a_dense_network_trains_on_raw_parameters_in_the_units_of_a_rig(tmp_path):
    inputs = write_artefacts(tmp_path)
    table = {"hidden": [16], "training": {"steps": 300}, "conditioning": {"inputs": "raw"}}
    settings = TrainingSettings(read_table(method_named("dense_released").default_section("quick"), table), 0, "cpu")
    inputs, notes = run_stage(dense_network.train, inputs, "dense_released", settings, tmp_path)
    *_, last = read_log(inputs["dense_released"] / "log.csv")
    samples, mesh = artefacts.load_samples(inputs), small_mesh()
    vertices = predicted(method_named("dense_released"), inputs, samples.validation_params)
    distance = np.linalg.norm(vertices - mesh.neutral - samples.validation_offsets, axis=2)[:, mesh.segment < 2]
    assert distance.mean() == pytest.approx(last[2], rel=1e-4), (
        "what is read is what was trained, raw parameters included"
    )
    assert notes["size_mb"] > 0
