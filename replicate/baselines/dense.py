"""The dense baseline: a multilayer perceptron a segment, every coordinate of every vertex an output (§5.1).

With a last hidden layer that is linear it is what engines call a neural morph model: the layer holds the weights of as
many shapes, and these, learned with the rest, are the rows of the output.
"""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import torch
from jaxtyping import Float
from torch import nn
from torch.nn import functional

from replicate.approximation.model import SegmentedModel, load_model, save_model
from replicate.approximation.segments import Segment
from replicate.config import DenseConfig


class DenseNetwork(nn.Module):
    """(b, j) scaled parameters → (b, k, 3) offsets through hidden layers with leaky ReLU and a linear output.

    inputs: j.
    vertices: k.
    hidden: widths of the layers that a leaky ReLU follows.
    slope: of the leaky ReLUs.
    shapes: the width of one more layer, without a ReLU: the weights of learned shapes; 0 for no such layer.
    """

    def __init__(self, inputs: int, vertices: int, hidden: Sequence[int], slope: float, shapes: int = 0):
        super().__init__()
        widths = (inputs, *hidden, shapes) if shapes else (inputs, *hidden)
        self.hidden = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise(widths))
        self.output = nn.Linear(widths[-1], 3 * vertices)
        self.slope = slope
        self.slopes = (slope,) * len(hidden) + (1.0,) * (len(self.hidden) - len(hidden))  # of each layer's leaky ReLU

    def forward(self, params: Float[torch.Tensor, "b j"]) -> Float[torch.Tensor, "b k 3"]:
        x = params
        for layer, slope in zip(self.hidden, self.slopes, strict=True):
            x = functional.leaky_relu(layer(x), slope)
        return self.output(x).unflatten(1, (-1, 3))


class Normalised(nn.Module):
    """A dense network in training, whose outputs are offsets less their mean, in units of their standard deviation.

    network: (b, j) → (b, k, 3).
    mean: (3k,), mm, float32, not trained.
    deviation: (3k,), likewise.
    """

    mean: torch.Tensor
    deviation: torch.Tensor

    def __init__(self, network: DenseNetwork, mean: torch.Tensor, deviation: torch.Tensor):
        super().__init__()
        self.network = network
        self.register_buffer("mean", mean)
        self.register_buffer("deviation", deviation)

    def forward(self, params: Float[torch.Tensor, "b j"]) -> Float[torch.Tensor, "b k 3"]:
        return torch.addcmul(self.mean, self.deviation, self.network(params).flatten(1)).unflatten(1, (-1, 3))

    def folded(self) -> DenseNetwork:
        """Return the network with mean and deviation in the weights of its last layer, so that it predicts mm."""
        output = self.network.output
        with torch.no_grad():
            output.weight.mul_(self.deviation[:, None])
            output.bias.mul_(self.deviation).add_(self.mean)
        return self.network


def make_network(segment: Segment, facts: dict) -> DenseNetwork:
    """Return a network for a segment; facts: hidden, leaky_slope, and shapes where there are some."""
    shape = (facts["hidden"], facts["leaky_slope"], facts.get("shapes", 0))
    return DenseNetwork(len(segment.parameters), len(segment.vertices), *shape)


def shape_facts(config: DenseConfig) -> dict:
    """Return the facts that `make_network` needs, JSON-ready."""
    return {"hidden": list(config.hidden), "leaky_slope": config.leaky_slope}


def save(model: SegmentedModel, folder: Path, config: DenseConfig) -> None:
    """Write a dense model to a folder."""
    save_model(model, folder, shape_facts(config))


def load_dense(folder: Path) -> SegmentedModel:
    """Read a dense model; its `.offsets(params)` predicts. Raises InputError when there is none."""
    return load_model(folder, make_network)
