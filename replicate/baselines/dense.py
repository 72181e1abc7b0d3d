"""The dense baseline: a multilayer perceptron a segment, every coordinate of every vertex an output (§5.1)."""

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
    """(b, j) scaled parameters → (b, k, 3) offsets through hidden layers with leaky ReLU and a linear output."""

    def __init__(self, inputs: int, vertices: int, hidden: Sequence[int], slope: float):
        super().__init__()
        self.hidden = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise((inputs, *hidden)))
        self.output = nn.Linear(hidden[-1], 3 * vertices)
        self.slope = slope

    def forward(self, params: Float[torch.Tensor, "b j"]) -> Float[torch.Tensor, "b k 3"]:
        x = params
        for layer in self.hidden:
            x = functional.leaky_relu(layer(x), self.slope)
        return self.output(x).unflatten(1, (-1, 3))


def make_network(segment: Segment, facts: dict) -> DenseNetwork:
    """Return a network for a segment; facts: hidden, leaky_slope."""
    return DenseNetwork(len(segment.parameters), len(segment.vertices), facts["hidden"], facts["leaky_slope"])


def shape_facts(config: DenseConfig) -> dict:
    """Return the facts that `make_network` needs, JSON-ready."""
    return {"hidden": list(config.hidden), "leaky_slope": config.leaky_slope}


def save(model: SegmentedModel, folder: Path, config: DenseConfig) -> None:
    """Write a dense model to a folder."""
    save_model(model, folder, shape_facts(config))


def load_dense(folder: Path) -> SegmentedModel:
    """Read a dense model; its `.offsets(params)` predicts. Raises InputError when there is none."""
    return load_model(folder, make_network)
