"""The dense baseline: its shape, and that it learns."""

import numpy as np
import torch
from small_face import small_samples, train_small
from torch.nn import functional

from replicate.baselines import dense
from replicate.config import DenseConfig, TrainingConfig


def test_the_network_is_two_hidden_layers_and_a_linear_output():
    network = dense.DenseNetwork(5, 4, (8, 6), 0.2)
    p = torch.randn(3, 5, generator=torch.Generator().manual_seed(0))
    (a, b), c = network.hidden, network.output
    assert [tuple(layer.weight.shape) for layer in (a, b, c)] == [(8, 5), (6, 8), (12, 6)]
    x = functional.leaky_relu(p @ a.weight.T + a.bias, 0.2)
    x = functional.leaky_relu(x @ b.weight.T + b.bias, 0.2)
    torch.testing.assert_close(network(p), (x @ c.weight.T + c.bias).view(3, 4, 3))


def test_training_learns_and_a_saved_model_predicts_the_same(tmp_path):
    config = DenseConfig(training=TrainingConfig("one_cycle", steps=200, peak_rate=5e-3))
    mesh, model, log = train_small(dense, config, tmp_path / "scratch")
    samples = small_samples(mesh)
    still = np.linalg.norm(samples.validation_offsets[:, mesh.segment < 2], axis=-1).mean()
    assert log[-1]["mm"] < 0.25 * still
    dense.save(model, tmp_path, config)
    params = samples.validation_params
    np.testing.assert_array_equal(dense.load_dense(tmp_path).offsets(params), model.offsets(params))
    assert not model.offsets(params)[:, mesh.segment == 2].any()
