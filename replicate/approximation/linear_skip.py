"""A straight line beside a network: the network learns what least squares leaves, and need not learn the line first."""

from collections.abc import Callable, Sequence

import numpy as np
import torch
from jaxtyping import Float
from torch import nn

from replicate.approximation.model import SegmentedModel
from replicate.approximation.segments import Segment


class Line(nn.Module):
    """(b, j) scaled parameters → (b, k, 3) offsets that are linear in them. Its weights count, and are not trained."""

    def __init__(self, inputs: int, vertices: int):
        super().__init__()
        self.weight = nn.Parameter(torch.zeros(inputs, 3 * vertices), requires_grad=False)
        self.bias = nn.Parameter(torch.zeros(3 * vertices), requires_grad=False)

    def forward(self, params: Float[torch.Tensor, "b j"]) -> Float[torch.Tensor, "b k 3"]:
        return torch.addmm(self.bias, params, self.weight).unflatten(1, (-1, 3))


class WithLine(nn.Module):
    """The sum of a network and a line, of the same shapes."""

    def __init__(self, network: nn.Module, line: Line):
        super().__init__()
        self.network, self.line = network, line

    @property
    def map_size(self) -> int:
        """The width of the network's map in pixels."""
        return self.network.map_size

    def forward(self, params: Float[torch.Tensor, "b j"]) -> Float[torch.Tensor, "b k 3"]:
        return self.network(params) + self.line(params)


def line_model(
    segments: Sequence[Segment], weights: Sequence[Float[np.ndarray, "_ _"]], scale: np.ndarray, vertex_count: int
) -> SegmentedModel:
    """Return the model of the straight lines that `methods.linear` fits; the last row of each segment's weights is
    the constant. scale: (m,), what parameters are divided by.
    """
    lines = []
    for segment, weight in zip(segments, weights, strict=True):
        line = Line(len(segment.parameters), len(segment.vertices))
        line.weight.copy_(torch.from_numpy(np.ascontiguousarray(weight[:-1])))
        line.bias.copy_(torch.from_numpy(np.ascontiguousarray(weight[-1])))
        lines.append(line)
    return SegmentedModel(lines, segments, scale, [1.0] * len(lines), vertex_count)


def add_line(model: SegmentedModel, lines: SegmentedModel) -> SegmentedModel:
    """Return the sum of a model and its straight lines, as one model whose networks are sums.

    Both see the same parameters on the same scale.
    """
    sums = []
    for network, line, length in zip(model.networks, lines.networks, model.lengths, strict=True):
        shorter = Line(
            line.weight.shape[0], line.weight.shape[1] // 3
        )  # a model multiplies what its networks give by their lengths
        shorter.weight.copy_(line.weight / length)
        shorter.bias.copy_(line.bias / length)
        sums.append(WithLine(network, shorter))
    return SegmentedModel(sums, model.segments, model.scale.cpu(), model.lengths, model.vertex_count)


def maker(make_network: Callable[[Segment, dict], nn.Module]) -> Callable[[Segment, dict], WithLine]:
    """Return the function that makes a network with a line of the right shape, for `model.load_model`."""

    def make(segment: Segment, facts: dict) -> WithLine:
        return WithLine(make_network(segment, facts), Line(len(segment.parameters), len(segment.vertices)))

    return make
