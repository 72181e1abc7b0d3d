"""The PCA network beside a line: exact where the rig is linear, nearer than either alone, and all of it counts."""

from dataclasses import replace

import numpy as np
import pytest
from small_artefacts import predicted, run_stage, straight_samples, write_artefacts
from small_face import small_mesh, small_samples

from replicate.baselines.line import onto_basis
from replicate.config import TrainingConfig
from replicate.methods import artefacts, linear, pca, pca_line
from replicate.methods.plan import StageSettings, TrainingSettings

SCHEDULE = TrainingConfig("one_cycle", 1_000, peak_rate=1e-2)
SECTION = pca_line.PcaLineConfig(components=20, hidden=(32,), normal_weight=0.0, training=SCHEDULE)


def fit(folder, section=SECTION, samples=None):
    inputs = write_artefacts(folder, samples)
    return run_stage(pca_line.train, inputs, "pca_line", TrainingSettings(section, 0, "cpu"), folder)


def mean_mm(inputs, method) -> float:
    samples, mesh = artefacts.load_samples(inputs), small_mesh()
    vertices = predicted(method.METHOD, inputs, samples.test_params)
    return np.abs(vertices - mesh.neutral - samples.test_offsets)[:, mesh.segment < 2].mean()


def test_the_skip_starts_as_the_least_squares_fit_of_the_coefficients(tmp_path):
    samples = artefacts.load_samples(write_artefacts(tmp_path, straight_samples()))
    vertices, scale = np.arange(100, dtype=np.int32), np.ones(12, np.float32)
    basis, mean = pca.components(samples, vertices, replace(SECTION, components=8), 0)  # its rank; the others are noise
    line, _ = pca_line.fit_line(samples, vertices, scale, basis, mean, (1e-12,))
    offsets = samples.vertices_subset(np.arange(len(samples)), vertices).reshape(len(samples), -1)
    exact = np.linalg.lstsq(linear.with_constant(samples.params), onto_basis(offsets, basis, mean))[0]
    np.testing.assert_allclose(line, exact, atol=1e-5)


def test_coefficients_give_back_what_lies_in_the_span():
    rng = np.random.default_rng(0)
    basis = (np.linalg.qr(rng.normal(size=(9, 3)))[0] * [3.0, 1.0, 0.5]).T.astype(np.float32)
    mean, coefficients = rng.normal(size=9).astype(np.float32), rng.normal(size=(4, 3))
    np.testing.assert_allclose(onto_basis(coefficients @ basis + mean, basis, mean), coefficients, atol=1e-5)


def test_a_linear_rig_needs_no_training(tmp_path):
    section = replace(SECTION, components=40, training=replace(SCHEDULE, steps=1, peak_rate=1e-9))
    inputs, _ = fit(tmp_path, section, straight_samples())
    untrained = mean_mm(inputs, pca_line)
    assert untrained < 0.1 * np.abs(artefacts.load_samples(inputs).test_offsets).mean(), "the layers start small"


def test_it_is_nearer_than_the_line_and_every_weight_counts(tmp_path):
    inputs, notes = fit(tmp_path, samples=small_samples(small_mesh(), 1_500))
    inputs, _ = run_stage(linear.fit, inputs, "linear", StageSettings(linear.default_section("quick"), 0), tmp_path)
    assert mean_mm(inputs, pca_line) < 0.9 * mean_mm(inputs, linear)
    deformable = int((small_mesh().segment < 2).sum())
    weights = 12 * 32 + 32 + 32 * 20 + 20 + 12 * 20
    assert notes["size_mb"] == pytest.approx(4e-6 * (weights + 21 * 3 * deformable))
    assert (inputs["pca_line"] / "log.csv").is_file()


def test_its_schedule_and_basis_are_those_of_the_pca_network():
    for profile in ("quick", "laptop", "paper"):
        beside, alone = pca_line.default_section(profile), pca.default_section(profile)
        assert all(getattr(beside, name) == value for name, value in vars(alone).items())
