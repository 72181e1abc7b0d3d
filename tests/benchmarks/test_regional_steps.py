"""The regional method's step on meshes and on coefficients: the same model, the same poses, targets that agree."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from small_face import small_influence, small_mesh, small_samples

from replicate.approximation.losses import Supervision
from replicate.benchmarks.bench_train import fresh_regional, regional_batches, regional_ways
from replicate.methods import regional

SECTION = replace(regional.RegionalConfig(), regions=4, components=6, fine=2, hidden=(8, 8), basis_samples=60)


@pytest.fixture(scope="module")
def steps():
    mesh = small_mesh()
    samples = small_samples(mesh, 60)
    supervision = Supervision(mesh, samples, np.arange(len(mesh.neutral)), 5.0, torch.device("cpu"))
    model, coefficients = fresh_regional(supervision, small_influence(mesh), SECTION, 0)
    (batch,) = regional_batches(supervision, coefficients, SECTION, 0, 1)
    return model, regional_ways(model, supervision), batch


def test_meshes_are_the_models_own(steps):
    model, ways, (params, _) = steps
    moved = ways["plain"][0](params).detach().numpy()
    np.testing.assert_allclose(moved, model.offsets(params.numpy()), atol=1e-4)


def test_both_losses_of_meshes_give_the_same_value_and_gradients(steps):
    model, ways, (params, target) = steps
    found = {}
    for name in ("plain", "loss"):
        module, loss = ways[name]
        module.zero_grad()
        value = loss(module(params), target)
        value.backward()
        found[name] = value.item(), [weight.grad.clone() for weight in model.network.parameters()]
    assert found["loss"][0] == pytest.approx(found["plain"][0], rel=1e-5)
    for here, there in zip(found["loss"][1], found["plain"][1], strict=True):
        torch.testing.assert_close(here, there, rtol=1e-3, atol=1e-5 * float(there.abs().max() + 1))


def test_coefficients_are_those_of_the_true_meshes(steps):
    model, ways, (params, (offsets, coefficients)) = steps
    moved = np.zeros_like(offsets)
    moved[:, model.vertices] = model.moved(coefficients).numpy()
    left = np.linalg.norm(moved - offsets.numpy(), axis=-1).mean()
    assert left < 0.5 * np.linalg.norm(offsets.numpy(), axis=-1).mean(), "what the basis can't hold"
    loss = ways["ours"][1]
    assert loss(coefficients, (offsets, coefficients)) < 1e-3 < loss(ways["ours"][0](params), (offsets, coefficients))
