"""The text's recipe: what it prints is in each row, and readings differ in what it leaves open alone."""

from dataclasses import replace

import numpy as np
import pytest
from small_artefacts import predicted, run_stage, write_artefacts

from replicate.base.schema import read_table
from replicate.config import resolve
from replicate.methods import artefacts, coarse, dense_network, printed
from replicate.methods.method_registry import method_named
from replicate.methods.plan import Plan, TrainingSettings

PRINTED = {"schedule": "paper", "batch": 8, "draws": "balanced", "rates": (1e-3, 1e-4, 1e-5), "largest_gradient": 0}


@pytest.mark.parametrize("method", printed.METHODS, ids=lambda method: method.name)
def test_each_row_has_what_the_text_prints_and_the_steps_of_the_code(method):
    section = method.default_section("laptop")
    assert {key: getattr(section.training, key) for key in PRINTED} == PRINTED
    unit_mm = 450.0 if method.name.endswith("_unit") else 1.0
    assert section.normal_weight == 5.0 and section.conditioning.unit_mm == unit_mm, "α goes with millimetres"
    assert section.training.steps == method.default_section("paper").training.steps == 70_000
    assert method.default_section("quick").training.steps < 1_000


@pytest.mark.parametrize("kind", printed.SECTIONS)
def test_readings_differ_only_in_what_is_left_open(kind):
    sections = [printed.section_of(kind, reading, "laptop") for reading in printed.READINGS]
    assert len({section.conditioning for section in sections}) == len(sections)
    assert len({replace(section, conditioning=sections[0].conditioning) for section in sections}) == 1


def test_refinement_adds_to_the_coarse_networks_of_its_own_reading():
    plan = Plan(resolve("tiny", "quick"))
    for reading in printed.READINGS:
        *_, last = method_named(f"refined_printed{reading}").stages(plan)
        assert f"coarse_printed{reading}" in {stage.name for stage in last.inputs}


@pytest.mark.parametrize("reading", ["", "_code"])
def test_all_rows_of_a_reading_train_and_what_is_read_is_what_was_trained(tmp_path, reading):
    inputs = write_artefacts(tmp_path)
    table = {"training": {"steps": 10}, "conditioning": {"inputs": "raw"}}  # this rig's controls have no such names
    for kind, train in (("coarse", coarse.train), ("dense", dense_network.train)):
        section = read_table(printed.section_of(kind, reading, "quick"), table)
        inputs, notes = run_stage(
            train, inputs, f"{kind}_printed{reading}", TrainingSettings(section, 0, "cpu"), tmp_path
        )
        params = artefacts.load_samples(inputs).validation_params
        vertices = predicted(method_named(f"{kind}_printed{reading}"), inputs, params)
        assert np.isfinite(vertices).all() and notes["size_mb"] > 0
