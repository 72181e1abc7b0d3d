"""The differential subspace as a row: near the truth after little training, and the same when it is read again."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from small_artefacts import predicted, run_stage, write_artefacts

from replicate.baselines.multiplications import of_model
from replicate.config import TrainingConfig
from replicate.methods import artefacts, differential
from replicate.methods.plan import TrainingSettings

SECTION = differential.DifferentialConfig(
    components=20,
    hidden=(128, 128),
    anchor_hidden=(16, 16),
    training=replace(differential.DESCENT, steps=500, batch=32, rates=(0.5,)),
    anchor_training=TrainingConfig("one_cycle", 300, batch=32, peak_rate=5e-3),
)


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    folder = tmp_path_factory.mktemp("trained")
    inputs = write_artefacts(folder)
    return run_stage(differential.train, inputs, "differential", TrainingSettings(SECTION, 0, "cpu"), folder)


def test_a_trained_network_is_near_the_truth(trained):
    inputs, notes = trained
    samples, mesh = artefacts.load_samples(inputs), artefacts.load_mesh(inputs)
    moved = mesh.segment < 2
    known = samples.offsets(np.arange(24))
    for params, truth, share in (samples.params[:24], known, 0.5), (samples.test_params, samples.test_offsets, 0.85):
        vertices = predicted(differential.PUBLISHED, inputs, params)
        wrong = np.abs(vertices - mesh.neutral - truth)[:, moved].mean()
        assert wrong < share * np.abs(truth[:, moved]).mean()
    assert notes["anchors"] == round(0.02 * moved.sum()) and notes["components"] == 20
    assert 0 < notes["anchor_error_mm"] < np.linalg.norm(samples.test_offsets[:, moved], axis=-1).mean()
    assert (inputs["differential"] / "log.csv").is_file()


def test_size_and_work_count_what_is_stored_and_what_each_network_sees(trained):
    inputs, notes = trained
    model = differential.METHODS[0].model(inputs)
    (network,), vertices = model.networks, len(model.vertices)
    sees = int(network.anchors.sees.sum())
    assert 0 < sees < network.anchors.sees.numel()
    wide, narrow = 12 * 128 + 128 * 128 + 128 * 20, sees * 16 + notes["anchors"] * (16 * 16 + 16 * 3)
    basis = 20 * 3 * vertices
    assert of_model(model) == wide + narrow + basis + 6 * notes["factor_nonzeros"]
    biases = 128 + 128 + 20 + notes["anchors"] * (16 + 16 + 3)
    assert notes["size_mb"] == model.size_mb() == pytest.approx(4e-6 * (wide + narrow + biases + basis + 3 * vertices))


def test_it_can_be_differentiated_by_the_controls_and_leaves_the_suite(trained):
    from replicate.inverse.at_vertices import at_vertices
    from replicate.timing.backends import onnx_evaluation

    inputs, _ = trained
    model, mesh = differential.METHODS[0].model(inputs), artefacts.load_mesh(inputs)
    params = np.asarray(artefacts.load_samples(inputs).test_params[:3])
    expected = mesh.neutral + model.offsets(params)
    points = at_vertices(model, np.array([5, 40]))
    start = torch.tensor(params).requires_grad_(True)
    found = points(start)
    np.testing.assert_allclose(mesh.neutral[[5, 40]] + found.detach().numpy(), expected[:, [5, 40]], atol=1e-4)
    found.sum().backward()
    assert start.grad.abs().max() > 0
    np.testing.assert_allclose(onnx_evaluation(model, mesh, None)(params), expected, atol=1e-3)


def test_both_widths_have_sections_of_their_own():
    for profile in ("quick", "laptop", "paper"):
        wide, small = differential.default_section(profile), differential.own_small(profile)
        assert (wide.hidden, small.hidden) == ((2048,) * 6, (512,) * 6)
        assert wide.training.steps <= small.training.steps
        assert wide.anchor_training == small.anchor_training
