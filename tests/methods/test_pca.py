"""The PCA network: its predictions lie in the span of its basis, and training brings them near the truth."""

import numpy as np
from small_artefacts import predicted, run_stage, write_artefacts

from replicate.config import TrainingConfig
from replicate.methods import artefacts, pca
from replicate.methods.plan import TrainingSettings

SECTION = pca.PcaConfig(components=20, hidden=(32,), training=TrainingConfig("one_cycle", 300, peak_rate=5e-3))


def test_a_trained_network_is_near_the_truth_and_in_the_span_of_its_components(tmp_path):
    inputs = write_artefacts(tmp_path)
    samples, mesh = artefacts.load_samples(inputs), artefacts.load_mesh(inputs)
    inputs, notes = run_stage(pca.train, inputs, "pca", TrainingSettings(SECTION, 0, "cpu"), tmp_path)
    moved = np.flatnonzero(mesh.segment < 2)
    vertices = predicted(pca.METHOD, inputs, samples.test_params)
    offsets = (vertices - mesh.neutral)[:, moved].reshape(len(vertices), -1)
    basis, mean = pca.components(samples, moved.astype(np.int32), SECTION, 0)
    outside = (offsets - mean) - (offsets - mean) @ np.linalg.pinv(basis.astype(float)) @ basis
    assert np.abs(outside).max() < 1e-3
    truth = np.asarray(samples.test_offsets)[:, moved].reshape(len(offsets), -1)
    assert np.abs(offsets - truth).mean() < 0.4 * np.abs(truth).mean()
    weights = 12 * 32 + 32 + 32 * 20 + 20
    assert notes["size_mb"] == (weights + basis.size + mean.size) * 4e-6
    assert (inputs["pca"] / "log.csv").is_file()


def test_components_are_as_long_as_their_standard_deviations(tmp_path):
    samples = artefacts.load_samples(write_artefacts(tmp_path))
    vertices = np.arange(100, dtype=np.int32)
    basis, mean = pca.components(samples, vertices, SECTION, 0)
    offsets = samples.vertices_subset(np.arange(len(samples)), vertices).reshape(len(samples), -1)
    coefficients = (offsets - mean) @ np.linalg.pinv(basis.astype(float))
    np.testing.assert_allclose(
        coefficients.std(0)[:8], 1, rtol=0.02
    )  # the others are rounding: the offsets have rank 8


def test_more_components_than_the_samples_have_are_not_asked_for(tmp_path):
    samples = artefacts.load_samples(write_artefacts(tmp_path))
    basis, _ = pca.components(samples, np.arange(4, dtype=np.int32), SECTION, 0)
    assert basis.shape == (12, 12)
