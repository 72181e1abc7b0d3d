"""A trained model with fewer shapes a region, for a smaller file: nothing is trained again."""

import copy

import numpy as np
import torch
from jaxtyping import Int
from torch import nn

from replicate.regional.model import RegionalModel, StoredBasis


def with_fewer_shapes(model: RegionalModel, count: int) -> RegionalModel:
    """Return a copy of a model with at most `count` components of each basis, the first ones, which move most."""
    kept = [basis.steps[:count] for basis in model.bases]
    bases = [
        StoredBasis(b.vertices, b.weights, b.mean, b.fine[:count], b.rough[: max(0, count - len(b.fine))], steps)
        for b, steps in zip(model.bases, kept, strict=True)
    ]
    firsts = np.cumsum([0, *(len(basis.steps) for basis in model.bases)])
    rows = np.concatenate([first + np.arange(len(steps)) for first, steps in zip(firsts, kept, strict=False)])
    network, first = copy.deepcopy(model.network), 0
    for part in network.networks:
        last = first + part.output.out_features
        own = torch.from_numpy(rows[(rows >= first) & (rows < last)] - first)
        part.output, part.line = _narrowed(part.output, own), part.line and _narrowed(part.line, own)
        first = last
    return RegionalModel(network, bases, model.scale.numpy(), model.length, model.vertex_count, model.rest)


def _narrowed(layer: nn.Linear, rows: Int[torch.Tensor, " k"]) -> nn.Linear:
    """Return a layer with some of another one's outputs."""
    twin = nn.Linear(layer.in_features, len(rows), bias=layer.bias is not None)
    with torch.no_grad():
        twin.weight.copy_(layer.weight[rows])
        if layer.bias is not None:
            twin.bias.copy_(layer.bias[rows])
    return twin
