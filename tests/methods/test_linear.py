"""The straight line: exact where a rig is linear, as good as its penalty allows elsewhere."""

import numpy as np
import pytest
from small_artefacts import predicted, run_stage, straight_samples, write_artefacts
from small_face import small_mesh

from replicate.methods import artefacts, linear
from replicate.methods.plan import StageSettings


def fit_linear(folder, samples=None):
    inputs = write_artefacts(folder, samples)
    return run_stage(linear.fit, inputs, "linear", StageSettings(linear.default_section("quick"), 0), folder)


def test_a_linear_rig_is_matched_to_the_quantisation_of_its_samples(tmp_path):
    inputs, notes = fit_linear(tmp_path, straight_samples())
    samples, mesh = artefacts.load_samples(inputs), small_mesh()
    vertices = predicted(linear.METHOD, inputs, samples.test_params)
    moved = mesh.segment < 2
    truth = mesh.neutral + samples.test_offsets
    assert np.abs(vertices - truth)[:, moved].max() < 2e-3
    assert notes["strength"] == min(linear.default_section("quick").strengths), (
        "no penalty is needed where there is no noise"
    )


def test_the_strength_is_the_best_on_the_validation_poses(tmp_path):
    inputs, notes = fit_linear(tmp_path)
    samples, mesh = artefacts.load_samples(inputs), artefacts.load_mesh(inputs)
    vertices = predicted(linear.METHOD, inputs, samples.validation_params)
    loss = np.square(vertices - mesh.neutral - samples.validation_offsets)
    still = np.square(samples.validation_offsets)
    assert 0 < loss[:, mesh.segment < 2].sum() < 0.2 * still[:, mesh.segment < 2].sum()
    assert notes["strength"] in linear.default_section("quick").strengths
    weights = 3 * len(mesh.neutral) * (samples.params.shape[1] + 1)
    assert notes["size_mb"] == pytest.approx(4e-6 * weights)


def test_ridge_agrees_with_its_closed_form_and_leaves_the_constant_free():
    rng = np.random.default_rng(0)
    inputs = linear.with_constant(rng.normal(size=(50, 3)))
    targets = rng.normal(size=(50, 2)) + 7
    (free,) = linear.ridge(inputs, iter([targets[:20], targets[20:]]), (0.0,))
    np.testing.assert_allclose(free, np.linalg.lstsq(inputs, targets)[0], atol=1e-9)
    (stiff,) = linear.ridge(inputs, iter([targets]), (1e5,))
    np.testing.assert_allclose(stiff[:3], 0, atol=1e-3)
    np.testing.assert_allclose(stiff[3], targets.mean(0), atol=1e-3)
