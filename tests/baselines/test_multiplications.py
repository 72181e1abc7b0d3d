"""The count of multiplications: what torch itself counts in the networks, layer by layer."""

import numpy as np
import pytest
import torch
from torch.utils.flop_counter import FlopCounterMode

from replicate.approximation.cnn import MapNetwork
from replicate.approximation.model import SegmentedModel
from replicate.approximation.refinement import RefinedModel
from replicate.approximation.segments import Segment
from replicate.baselines.dense import DenseNetwork
from replicate.baselines.line import CoefficientsBesideLine, Line, WithLine
from replicate.baselines.low_rank_dense import low_rank, output_components
from replicate.baselines.multiplications import of_blend, of_model, of_network
from replicate.baselines.ridge import ProductShapes, SquaresLine
from replicate.baselines.skinning.bone_network import BoneNetwork
from replicate.baselines.skinning.ssdr import Skin
from replicate.methods.pca import make_network
from replicate.regional.model import RegionalModel, StoredBasis
from replicate.regional.networks import fresh_networks

UV = np.random.default_rng(1).uniform(0, 1, (40, 2)).astype(np.float32)
SEGMENT = Segment("face", np.arange(40, dtype=np.int32), UV, np.arange(7, dtype=np.int32))
READING = 4 * 3 * 40  # four pixels of three coordinates, 40 vertices


def counted(forward, inputs: int = 7) -> int:
    """Return how many multiplications torch counts in a pass of one pose."""
    with FlopCounterMode(display=False) as counter, torch.no_grad():
        forward(torch.zeros(1, inputs))
    return counter.get_total_flops() // 2


def basis(components: int = 5) -> tuple[torch.Tensor, torch.Tensor]:
    return torch.zeros(components, 120), torch.zeros(120)


def compacted() -> torch.nn.Module:
    network = DenseNetwork(7, 40, (16, 32), 0.2)
    hidden = np.random.default_rng(0).normal(size=(99, 32))
    parts = output_components(network.output.weight.detach().numpy(), np.zeros(120), hidden)
    return low_rank(network, SEGMENT, parts, 11, 1.0)


@pytest.mark.parametrize(
    "network",
    [
        DenseNetwork(7, 40, (16, 32), 0.2),
        DenseNetwork(7, 40, (16, 32), 0.2, shapes=9),
        Line(7, 40),
        WithLine(DenseNetwork(7, 40, (16,), 0.2), Line(7, 40)),
        SquaresLine(7, 40),
        ProductShapes(torch.zeros(7), 6, 40),
        make_network(7, *basis(), (16,), 0.2),
        CoefficientsBesideLine(7, *basis(), (16,), 0.2),
        compacted(),
    ],
    ids=lambda network: type(network).__name__,
)
def test_a_network_has_the_multiplications_that_torch_counts(network):
    assert of_network(network) == counted(network) > 0


@pytest.mark.parametrize("size", [16, 32, 64])
def test_a_map_network_counts_as_the_figure_draws_it_with_the_reading_of_its_vertices(size):
    network = MapNetwork(7, UV, size, 16, (32, 128), 0.2)
    assert of_network(network) == counted(network.maps) + READING
    assert of_network(WithLine(network, Line(7, 40))) == of_network(network) + 7 * 120


def test_a_model_counts_all_of_its_networks_on_both_levels():
    networks = [DenseNetwork(7, 40, (16,), 0.2), DenseNetwork(7, 40, (8,), 0.2)]
    model = SegmentedModel(networks, [SEGMENT, SEGMENT], np.ones(7), [1.0, 1.0], 40)
    each = [7 * 16 + 16 * 120, 7 * 8 + 8 * 120]
    assert of_model(model) == sum(each)
    assert of_model(RefinedModel(model, model.part([1]))) == sum(each) + each[1]


def test_a_model_that_counts_its_work_itself_is_asked():
    network = fresh_networks([np.arange(5), np.arange(7)], (16,), [5, 4], gated=True, line=True)
    shapes = [(torch.ones(1), *map(torch.zeros, ((1, 3), (2, 1, 3), (k, 1, 3), 2 + k))) for k in (3, 2)]
    networks = 5 * 32 + 16 * 5 + 5 * 5 + 7 * 32 + 16 * 4 + 7 * 4
    for second, weights in ((1, 0), (0, 6)):  # apart, and both of the same vertex
        bases = [StoredBasis(torch.tensor([own]), *parts) for own, parts in zip((0, second), shapes, strict=True)]
        model = RegionalModel(network, bases, np.ones(7), 1.0, 40)
        assert of_model(model) == networks + 9 * 3 + weights


def test_a_blend_counts_the_weights_that_there_are():
    weights = np.float32([[0.5, 0.5], [1.0, 0.0], [0.25, 0.75]])
    assert of_blend(weights) == 12 * 5
    neutral = np.random.default_rng(0).normal(size=(3, 3)).astype(np.float32)
    skin = Skin(neutral, np.int32([[0, 1], [1, 0], [0, 1]]), weights, 2)
    assert of_network(BoneNetwork(7, skin, (16,), 0.2)) == 12 * 5 + 7 * 16 + 16 * 12
