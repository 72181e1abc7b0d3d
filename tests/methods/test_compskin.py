"""Compressed skinning as a row: near the truth after little training, small, and the same when it is read again."""

import numpy as np
import pytest
import torch
from small_artefacts import predicted, run_stage, write_artefacts

from replicate.baselines.multiplications import of_model
from replicate.config import TrainingConfig
from replicate.methods import artefacts, compskin
from replicate.methods.plan import TrainingSettings

SECTION = compskin.CompskinConfig(
    components=12,
    bones=24,
    numbers=1_000,
    smoothness=0.0,
    steps=150,
    rate=1e-2,
    hidden=(32,),
    training=TrainingConfig("one_cycle", 400, peak_rate=5e-3),
)


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    folder = tmp_path_factory.mktemp("trained")
    inputs = write_artefacts(folder)
    return run_stage(compskin.train, inputs, "compskin", TrainingSettings(SECTION, 0, "cpu"), folder)


def test_a_trained_network_is_near_the_truth(trained):
    inputs, _ = trained
    samples, mesh = artefacts.load_samples(inputs), artefacts.load_mesh(inputs)
    moved = mesh.segment < 2
    vertices = predicted(compskin.METHODS[0], inputs, samples.test_params)
    wrong = np.abs(vertices - mesh.neutral - samples.test_offsets)[:, moved].mean()
    assert wrong < 0.6 * np.abs(samples.test_offsets[:, moved]).mean()
    assert (inputs["compskin"] / "log.csv").is_file()


def test_size_and_work_are_those_of_what_is_not_zero(trained):
    inputs, notes = trained
    model = compskin.METHODS[0].model(inputs)
    (network,) = model.networks
    numbers, weights = notes["numbers"], network.weights()
    assert 0 < numbers <= 1_000 and len(model.vertices) <= weights <= 8 * len(model.vertices)
    layers = 12 * 32 + 32 * 12
    assert of_model(model) == layers + numbers + 12 * weights
    stored = layers + 32 + 12 + 2 * numbers + 2 * weights + 3 * notes["bones"]
    assert notes["size_mb"] == model.size_mb() == pytest.approx(4e-6 * stored)


def test_it_can_be_differentiated_by_the_controls_and_leaves_the_suite(trained):
    from replicate.inverse.at_vertices import at_vertices
    from replicate.timing.backends import onnx_evaluation

    inputs, _ = trained
    model, mesh = compskin.METHODS[0].model(inputs), artefacts.load_mesh(inputs)
    params = np.asarray(artefacts.load_samples(inputs).test_params[:3])
    expected = mesh.neutral + model.offsets(params)
    start = torch.tensor(params).requires_grad_(True)
    found = at_vertices(model, np.array([5, 40]))(start)
    np.testing.assert_allclose(mesh.neutral[[5, 40]] + found.detach().numpy(), expected[:, [5, 40]], atol=1e-4)
    found.sum().backward()
    assert start.grad.abs().max() > 0
    np.testing.assert_allclose(onnx_evaluation(model, mesh, None)(params), expected, atol=1e-3)


def test_the_larger_skin_differs_in_what_it_may_store():
    for profile in ("quick", "laptop", "paper"):
        published, larger = compskin.default_section(profile), compskin.own_best(profile)
        assert (published.bones, published.weights, published.numbers) == (40, 8, 6_000)
        assert larger.bones > 40 and larger.numbers > 6_000 and larger.training == published.training
    assert compskin.default_section("paper").steps == 10_000 and compskin.default_section("paper").rate == 1e-3
