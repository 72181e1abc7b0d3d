"""The networks of Fig. 3: their shapes, their fast forms against the figure, and that they learn."""

import numpy as np
import pytest
import torch
from small_face import small_samples, train_small
from torch import nn
from torch.nn import functional

from replicate.approximation import cnn
from replicate.approximation.conditioning import initialise
from replicate.approximation.deformation_map import bilinear, sample
from replicate.base.exceptions import InputError
from replicate.config import CoarseConfig, ConditioningConfig, TrainingConfig
from replicate.kernels import map_kernel

UV = np.random.default_rng(1).uniform(0, 1, (40, 2)).astype(np.float32)


def network(map_size=32, inputs=7) -> cnn.MapNetwork:
    map_network = cnn.MapNetwork(inputs, UV, map_size, 16, (256, 512), 0.2)
    generator = torch.Generator().manual_seed(0)
    initialise(ConditioningConfig(), [map_network], 0.2, generator)
    for layer in map_network.modules():
        if isinstance(layer, nn.Linear | nn.Conv2d):
            layer.bias.data.normal_(0, 0.1, generator=generator)
    return map_network


def test_the_weights_are_those_that_table_1_implies():
    for map_size, levels in ((32, 2), (64, 3)):
        dense = (256 * 7 + 256) + (256 * 512 + 512)
        convolutions = (8 * 16 * 9 + 16) + levels * (16 * 16 * 9 + 16) + (16 * 3 + 3)
        assert sum(weight.numel() for weight in network(map_size).parameters()) == dense + convolutions


@pytest.mark.parametrize("map_size", [32, 64])
def test_the_networks_equal_the_figure_in_value_and_gradient(map_size):
    map_network = network(map_size)
    params = torch.randn(9, 7, generator=torch.Generator().manual_seed(2))
    grid = bilinear(UV, map_size)
    upstream = torch.randn(9, 40, 3, generator=torch.Generator().manual_seed(3))
    results = []
    for run in (
        lambda p: sample(map_network.maps(p), torch.from_numpy(grid.pixels), torch.from_numpy(grid.weights)),
        map_network.forward,
    ):
        map_network.zero_grad()
        p = params.clone().requires_grad_()
        out = run(p)
        out.backward(upstream)
        results.append([out.detach(), p.grad] + [weight.grad.clone() for weight in map_network.parameters()])
    for clear, fast in zip(*results, strict=True):
        scale = clear.abs().max()
        assert scale > 1e-3
        torch.testing.assert_close(fast / scale, clear / scale, atol=2e-5, rtol=0)


@pytest.mark.parametrize("map_size", [32, 64])
def test_what_images_hold_where_nothing_is_read_does_not_matter(map_size):
    map_network, params = network(map_size), torch.randn(3, 7, generator=torch.Generator().manual_seed(4))

    def gradients():
        map_network.zero_grad()
        out = map_network(params)
        out.square().sum().backward()
        return [out.detach(), *(weight.grad.clone() for weight in map_network.parameters())]

    before = gradients()
    for length, images in map_kernel._images.items():
        side = round((length / 3 / 16) ** 0.5)
        for image in images if 3 * 16 * side**2 == length else ():
            image.reshape(3, side, side, 16)[:, 1:-1, 1:-1] = np.nan
    for images in map_kernel._gradients.values():
        for image in images:
            image[:] = np.nan
    for one, other in zip(before, gradients(), strict=True):
        assert torch.equal(one, other)


def test_vertices_that_are_replaced_read_their_own_pixels():
    map_network, params = network(), torch.randn(2, 7, generator=torch.Generator().manual_seed(6))
    before = map_network(params).detach()
    grid = bilinear(UV[::-1], 32)
    map_network.pixels, map_network.shares = torch.from_numpy(grid.pixels), torch.from_numpy(grid.weights)
    torch.testing.assert_close(map_network(params).detach(), before.flip(1))
    few = bilinear(1 - UV[:3], 32)
    map_network.pixels, map_network.shares = torch.from_numpy(few.pixels), torch.from_numpy(few.weights)
    torch.testing.assert_close(
        map_network(params), sample(map_network.maps(params), map_network.pixels, map_network.shares)
    )


def test_nearest_upsampling_is_four_copies_of_each_pixel():
    """The figure's upsampling, which both forms rely on, on an image that can be checked by hand."""
    map_network = cnn.MapNetwork(1, UV, 16, 1, (64,), 0.2)
    with torch.no_grad():
        for weight in map_network.parameters():
            weight.zero_()
        for layer in (*map_network.upsampled, map_network.last):
            layer.weight[0, 0, 1, 1] = 1  # passes its image on
        map_network.dense[0].bias.copy_(torch.arange(1.0, 65))
        map_network.output.weight[:] = 1
    image = torch.arange(1.0, 65).view(8, 8)
    expected = image.repeat_interleave(2, 0).repeat_interleave(2, 1)
    torch.testing.assert_close(map_network.maps(torch.zeros(1, 1))[0, :, :, 2].detach(), expected)


def test_the_first_maps_are_eight_by_eight_with_channels_last():
    map_network = network()
    start = map_network._start(torch.zeros(1, 7))
    hidden = functional.leaky_relu(map_network.dense[0](torch.zeros(1, 7)), 0.2)
    torch.testing.assert_close(start[0], map_network.dense[1](hidden)[0].view(8, 8, 8))


def test_other_widths_than_the_papers_take_the_clear_way():
    map_network = cnn.MapNetwork(7, UV, 16, 12, (32, 128), 0.2)
    grid, params = bilinear(UV, 16), torch.randn(2, 7)
    expected = sample(map_network.maps(params), torch.from_numpy(grid.pixels), torch.from_numpy(grid.weights))
    torch.testing.assert_close(map_network(params), expected)


def test_two_forward_passes_before_their_gradients_do_not_disturb_each_other():
    map_network = network()
    first, second = torch.randn(2, 3, 7, generator=torch.Generator().manual_seed(5))
    alone = torch.autograd.grad(map_network(first).sum(), map_network.parameters())
    out = map_network(first).sum()
    map_network(second).sum().backward()
    for one, other in zip(alone, torch.autograd.grad(out, map_network.parameters()), strict=True):
        assert torch.equal(one, other)


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    config = CoarseConfig(map_size=16, training=TrainingConfig("one_cycle", steps=250, peak_rate=5e-3))
    return *train_small(cnn, config, tmp_path_factory.mktemp("scratch")), config


def test_training_comes_well_below_the_neutral_pose(trained):
    mesh, model, log, _ = trained
    samples = small_samples(mesh)
    still = np.linalg.norm(samples.validation_offsets[:, mesh.segment < 2], axis=-1).mean()
    assert log[-1]["mm"] < 0.25 * still
    predicted = model.offsets(samples.validation_params)
    error = np.linalg.norm(predicted - samples.validation_offsets, axis=-1)[:, mesh.segment < 2].mean()
    assert error == pytest.approx(log[-1]["mm"], rel=1e-4)
    assert not predicted[:, mesh.segment == 2].any()


def test_a_parameter_without_influence_changes_nothing(trained):
    mesh, model, *_ = trained
    params = np.zeros((2, 12), np.float32)
    params[1, 9:] = 0.7  # 9 moves the neck, 10 and 11 nothing
    still, moved = model.offsets(params)
    np.testing.assert_array_equal(still[mesh.segment == 0], moved[mesh.segment == 0])
    assert np.abs(still - moved)[mesh.segment == 1].max() > 0.1


def test_a_saved_model_predicts_the_same_and_a_missing_one_is_named(trained, tmp_path):
    _, model, _, config = trained
    cnn.save(model, tmp_path, config)
    params = np.random.default_rng(0).uniform(-1, 1, (5, 12)).astype(np.float32)
    np.testing.assert_array_equal(cnn.load_coarse(tmp_path).offsets(params), model.offsets(params))
    with pytest.raises(InputError, match="nowhere"):
        cnn.load_coarse(tmp_path / "nowhere")
