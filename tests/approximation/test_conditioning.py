"""What a training starts from: the sizes of inputs, outputs and first weights, ours and those of the released code."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from torch import nn

from replicate.approximation.conditioning import initialise, input_scale, output_lengths
from replicate.approximation.segments import Segment
from replicate.config import ConditioningConfig

PARAMS = np.array([[0.5, -2.0, 0.0], [-0.25, 1.0, 0.0]], np.float32)
RELEASED = ConditioningConfig("released", 450.0, "released")


def rig(*names):
    return lambda: SimpleNamespace(controls=[SimpleNamespace(name=name) for name in names])


def no_rig():
    raise AssertionError("a rig takes long to build, and its names decide nothing here")


def test_parameters_are_divided_by_their_largest_value_and_one_that_rests_by_1():
    np.testing.assert_array_equal(input_scale(ConditioningConfig(), PARAMS, no_rig), [0.5, 2.0, 1.0])


def test_raw_parameters_stay_as_they_are():
    np.testing.assert_array_equal(input_scale(ConditioningConfig("raw"), PARAMS, no_rig), [1.0, 1.0, 1.0])


def test_released_parameters_are_in_degrees_and_lengths_of_the_rig():
    scale = input_scale(RELEASED, PARAMS, rig("jaw_open", "lip_upper_03_x", "smile_left"))
    np.testing.assert_allclose(1 / scale, [22.0, 0.05, 1.0], rtol=1e-6)


def test_outputs_are_in_the_length_of_their_targets_or_in_the_units_of_the_rig():
    no_uv, none = np.zeros((2, 2), np.float32), np.zeros(0, np.int32)
    segments = [
        Segment("a", np.array([0, 1], np.int32), no_uv, none),
        Segment("b", np.array([2, 3], np.int32), no_uv, none),
    ]
    targets = np.zeros((5, 4, 3), np.float32)
    targets[:, :2] = 3.0
    assert output_lengths(ConditioningConfig(), segments, targets) == pytest.approx([3.0, 1.0])
    assert output_lengths(RELEASED, segments, targets) == [450.0, 450.0]


def layers():
    network = nn.Module()
    network.hidden, network.convolution, network.output = nn.Linear(400, 600), nn.Conv2d(16, 64, 3), nn.Linear(600, 300)
    return network


def drawn(config):
    network = layers()
    initialise(config, [network], 0.2, torch.Generator().manual_seed(0))
    assert not any(layer.bias.any() for layer in network.children())
    return network.requires_grad_(False)


def test_first_weights_keep_the_variance_but_for_a_small_output():
    network = drawn(ConditioningConfig())
    gain = (2 / 1.04) ** 0.5
    assert network.hidden.weight.std() == pytest.approx(gain / 400**0.5, rel=0.01)
    assert network.convolution.weight.std() == pytest.approx(gain / 144**0.5, rel=0.03)
    assert network.output.weight.std() == pytest.approx(0.1 * gain / 600**0.5, rel=0.01)


def test_released_first_weights_are_uniform_and_those_of_convolutions_small_and_cut_off():
    network = drawn(RELEASED)
    for layer, limit in ((network.hidden, (6 / 1000) ** 0.5), (network.output, (6 / 900) ** 0.5)):
        assert layer.weight.abs().max() == pytest.approx(limit, rel=0.01)
        assert layer.weight.std() == pytest.approx(limit / 3**0.5, rel=0.01)
    assert network.convolution.weight.abs().max() == pytest.approx(0.04, rel=0.02)
    assert network.convolution.weight.std() == pytest.approx(0.02 * 0.8796, rel=0.03)  # of a normal cut off at 2 sd
