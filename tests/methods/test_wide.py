"""Wider decoders: only widths differ from the paper's networks, and both levels train, load and count them."""

from dataclasses import replace

import numpy as np
import pytest
from small_artefacts import predicted, run_stage, write_artefacts
from small_face import small_mesh

from replicate.approximation.model_size import cnn_weights
from replicate.approximation.refinement import square_segments
from replicate.approximation.segments import save_segments
from replicate.config import TrainingConfig, resolve
from replicate.methods import artefacts, coarse, refined
from replicate.methods.method_registry import method_named
from replicate.methods.plan import Plan, TrainingSettings
from replicate.report.results import read_log


@pytest.mark.parametrize("profile", ["quick", "laptop", "paper"])
def test_all_but_the_widths_is_as_in_the_papers_networks(profile):
    config = resolve("tiny", profile)
    for name, section in (("coarse_wide", config.coarse), ("refined_wide", config.refinement)):
        ours = method_named(name).default_section(profile)
        assert (ours.hidden, ours.channels) == ((256, 2_048), 32)
        assert replace(ours, hidden=section.hidden, channels=section.channels) == section


@pytest.mark.parametrize("profile", ["quick", "laptop", "paper"])
def test_the_longer_training_has_the_steps_of_both_levels_and_nothing_else(profile):
    config, ours = resolve("tiny", profile), method_named("coarse_longer").default_section(profile)
    assert ours.training.steps == config.coarse.training.steps + config.refinement.training.steps
    assert replace(ours, training=replace(ours.training, steps=config.coarse.training.steps)) == config.coarse
    (stage,) = method_named("coarse_longer").stages(Plan(config))
    assert stage.name == "coarse_longer"


def test_the_refinement_builds_on_the_wide_networks_and_the_usual_squares():
    plan = Plan(resolve("tiny", "quick"))
    first, second = method_named("refined_wide").stages(plan)
    assert (first.name, second.name) == ("coarse_wide", "refined_wide")
    assert first in second.inputs and artefacts.squares_stage(plan) in second.inputs
    assert coarse.stage(plan) not in second.inputs


def test_both_levels_are_read_as_they_were_trained(tmp_path):
    inputs = write_artefacts(tmp_path)
    schedule = TrainingConfig("one_cycle", 30, 4, "uniform")
    shape = {"hidden": (16, 256), "channels": 5, "map_size": 16, "training": schedule}
    section = replace(method_named("coarse_wide").default_section("quick"), **shape)
    inputs, notes = run_stage(coarse.train, inputs, "coarse_wide", TrainingSettings(section, 0, "cpu"), tmp_path)
    segments = artefacts.load_coarse_segments(inputs, small_mesh())
    weights = sum(cnn_weights(len(segment.parameters), section) for segment in segments)
    assert notes["size_mb"] == pytest.approx(4e-6 * weights)
    squares = square_segments(segments[0], np.array([[0.3, 0.7]]), artefacts.load_influence(inputs), 0.4)
    inputs["selection"] = tmp_path / "selection"
    inputs["selection"].mkdir()
    save_segments(squares, inputs["selection"] / artefacts.SQUARES)
    section = replace(method_named("refined_wide").default_section("quick"), **(shape | {"map_size": 32}))
    inputs, notes = run_stage(refined.train, inputs, "refined_wide", TrainingSettings(section, 0, "cpu"), tmp_path)
    assert notes["size_mb"] > 4e-6 * weights, "both levels count"
    samples, mesh = artefacts.load_samples(inputs), small_mesh()
    vertices = predicted(method_named("refined_wide"), inputs, samples.validation_params)
    distance = np.linalg.norm(vertices - mesh.neutral - samples.validation_offsets, axis=2)[:, mesh.segment < 2]
    *_, last = read_log(inputs["refined_wide"] / "log.csv")
    assert distance.mean() == pytest.approx(last[2], rel=1e-3)
