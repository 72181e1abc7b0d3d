"""Networks beside a straight line: nothing is left to learn where the rig is linear, and less elsewhere."""

from dataclasses import replace

import numpy as np
import pytest
from small_artefacts import predicted, run_stage, straight_samples, write_artefacts
from small_face import small_mesh, small_samples

from replicate.config import CoarseConfig, DenseConfig, RefinementConfig, TrainingConfig
from replicate.methods import artefacts, linear, with_line
from replicate.methods.method_registry import method_named
from replicate.methods.plan import StageSettings, TrainingSettings
from replicate.report.results import read_log

SCHEDULE = TrainingConfig("one_cycle", 400, peak_rate=5e-3)
COARSE = CoarseConfig(map_size=16, normal_weight=0.0, training=SCHEDULE)  # what the test measures: positions


def fit(folder, samples=None):
    inputs = write_artefacts(folder, samples or small_samples(small_mesh(), 1_500))
    settings = StageSettings(linear.default_section("quick"), 0)
    inputs, _ = run_stage(linear.fit, inputs, "linear", settings, folder)
    return run_stage(linear.fit_lines, inputs, linear.LINES, settings, folder)


def errors(inputs, name: str) -> float:
    samples, mesh = artefacts.load_samples(inputs), small_mesh()
    vertices = predicted(method_named(name), inputs, samples.test_params)
    return np.abs(vertices - mesh.neutral - samples.test_offsets)[:, mesh.segment < 2].mean()


def test_a_linear_rig_leaves_the_networks_nothing_to_learn(tmp_path):
    inputs, _ = fit(tmp_path, straight_samples())
    section = replace(COARSE, training=replace(SCHEDULE, steps=1))
    inputs, _ = run_stage(with_line.train_coarse, inputs, "coarse_line", TrainingSettings(section, 0, "cpu"), tmp_path)
    assert errors(inputs, "coarse_line") < 2e-3


@pytest.mark.parametrize(
    "name, train, section",
    [
        ("coarse_line", with_line.train_coarse, COARSE),
        ("dense_line", with_line.train_dense, DenseConfig((32,), normal_weight=0.0, training=SCHEDULE)),
    ],
)
def test_a_network_beside_the_line_is_nearer_than_the_line_alone_and_both_count(tmp_path, name, train, section):
    inputs, line = fit(tmp_path)
    inputs, notes = run_stage(train, inputs, name, TrainingSettings(section, 0, "cpu"), tmp_path)
    assert errors(inputs, name) < errors(inputs, "linear")
    assert notes["size_mb"] > line["size_mb"]
    *_, last = read_log(inputs[name] / "log.csv")
    samples, mesh = artefacts.load_samples(inputs), small_mesh()
    vertices = predicted(method_named(name), inputs, samples.validation_params)
    distance = np.linalg.norm(vertices - mesh.neutral - samples.validation_offsets, axis=2)[:, mesh.segment < 2]
    assert distance.mean() == pytest.approx(last[2], rel=1e-4), "what is read is what was trained, line included"


def test_refinement_adds_to_the_coarse_networks_beside_the_line(tmp_path):
    from replicate.approximation.refinement import square_segments
    from replicate.approximation.segments import save_segments
    from replicate.methods import artefacts

    inputs, _ = fit(tmp_path)
    inputs, _ = run_stage(with_line.train_coarse, inputs, "coarse_line", TrainingSettings(COARSE, 0, "cpu"), tmp_path)
    first = artefacts.load_coarse_segments(inputs, small_mesh())[0]
    squares = square_segments(first, np.array([[0.3, 0.7]]), artefacts.load_influence(inputs), 0.4)
    inputs["selection"] = tmp_path / "selection"
    inputs["selection"].mkdir()
    save_segments(squares, inputs["selection"] / artefacts.SQUARES)
    section = RefinementConfig(map_size=16, normal_weight=0.0, training=SCHEDULE)
    inputs, _ = run_stage(
        with_line.train_refined, inputs, "refined_line", TrainingSettings(section, 0, "cpu"), tmp_path
    )
    assert errors(inputs, "refined_line") < errors(inputs, "coarse_line")
