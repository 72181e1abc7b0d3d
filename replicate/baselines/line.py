"""Linear regression beside a network: on offsets, and on the coefficients of a basis."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import cast

import numpy as np
import torch
from jaxtyping import Float, Float64
from torch import nn
from torch.nn import functional

from replicate.approximation.model import SegmentedModel
from replicate.approximation.segments import Segment
from replicate.regional.networks import OUTPUT_SHARE


class Line(nn.Module):
    """(b, j) scaled parameters → (b, k, 3) offsets that are linear in them. Its weights are fitted, not trained."""

    def __init__(self, inputs: int, vertices: int):
        super().__init__()
        self.weight = nn.Parameter(torch.zeros(inputs, 3 * vertices), requires_grad=False)
        self.bias = nn.Parameter(torch.zeros(3 * vertices), requires_grad=False)

    def forward(self, params: Float[torch.Tensor, "b j"]) -> Float[torch.Tensor, "b k 3"]:
        return torch.addmm(self.bias, params, self.weight).unflatten(1, (-1, 3))

    def set_weights(self, weights: Float[np.ndarray, "i d"]) -> None:
        """Set the weights, and the constant from the last row."""
        self.weight.copy_(torch.from_numpy(np.ascontiguousarray(weights[:-1])))
        self.bias.copy_(torch.from_numpy(np.ascontiguousarray(weights[-1])))


class WithLine(nn.Module):
    """The sum of a network and a line, of the same shapes."""

    def __init__(self, network: nn.Module, line: Line):
        super().__init__()
        self.network, self.line = network, line

    @property
    def map_size(self) -> int:
        """The width of the network's map in pixels."""
        return cast(int, self.network.map_size)

    def forward(self, params: Float[torch.Tensor, "b j"]) -> Float[torch.Tensor, "b k 3"]:
        return self.network(params) + self.line(params)


def line_model(
    segments: Sequence[Segment], weights: Sequence[Float[np.ndarray, "_ _"]], scale: np.ndarray, vertex_count: int
) -> SegmentedModel:
    """Return the model of straight lines, one for each segment.

    weights: a segment's are (j + 1, 3k), the constant in the last row. scale: (m,), what parameters are divided by.
    """
    lines = []
    for segment, weight in zip(segments, weights, strict=True):
        lines.append(Line(len(segment.parameters), len(segment.vertices)))
        lines[-1].set_weights(weight)
    return SegmentedModel(lines, segments, scale, [1.0] * len(lines), vertex_count)


def add_line(model: SegmentedModel, lines: SegmentedModel) -> SegmentedModel:
    """Return the sum of a model and its straight lines as one model; both see the same parameters on the same scale."""
    sums = []
    for network, line, length in zip(model.networks, lines.networks, model.lengths, strict=True):
        shorter = Line(line.weight.shape[0], line.weight.shape[1] // 3)  # as outputs are multiplied by the length
        shorter.weight.copy_(line.weight / length)
        shorter.bias.copy_(line.bias / length)
        sums.append(WithLine(network, shorter))
    return SegmentedModel(sums, model.segments, model.scale.cpu(), model.lengths, model.vertex_count)


def maker(make_network: Callable[[Segment, dict], nn.Module]) -> Callable[[Segment, dict], WithLine]:
    """Return a function that makes a network beside a line of the right shape, for `model.load_model`."""

    def make(segment: Segment, facts: dict) -> WithLine:
        return WithLine(make_network(segment, facts), Line(len(segment.parameters), len(segment.vertices)))

    return make


# A network and a straight line to the coefficients of a basis: the PCA network's layers beside a linear skip.


class CoefficientsBesideLine(nn.Module):
    """(b, m) scaled parameters → (b, k, 3) offsets in mm, in the span of a basis.

    inputs: m.
    basis: (c, 3k) components, float32, not trained.
    mean: (3k,), likewise.
    hidden: widths of the layers, each followed by a leaky ReLU.
    slope: of the leaky ReLUs.
    """

    basis: torch.Tensor
    mean: torch.Tensor

    def __init__(self, inputs: int, basis: torch.Tensor, mean: torch.Tensor, hidden: Sequence[int], slope: float):
        super().__init__()
        layers = [nn.Linear(a, b) for a, b in pairwise((inputs, *hidden))]
        self.hidden = cast(Sequence[nn.Linear], nn.ModuleList(layers))
        self.output = nn.Linear(hidden[-1], len(basis))
        self.line = nn.Linear(inputs, len(basis), bias=False)
        self.slope = slope
        self.register_buffer("basis", basis)
        self.register_buffer("mean", mean)

    def coefficients(self, params: Float[torch.Tensor, "b m"]) -> Float[torch.Tensor, "b c"]:
        """Return the coefficients of the basis."""
        x = params
        for layer in self.hidden:
            x = functional.leaky_relu(layer(x), self.slope)
        return self.output(x) + self.line(params)

    def forward(self, params: Float[torch.Tensor, "b m"]) -> Float[torch.Tensor, "b k 3"]:
        return torch.addmm(self.mean, self.coefficients(params), self.basis).unflatten(1, (-1, 3))

    def start(self, line: Float[np.ndarray, "i c"], generator: torch.Generator) -> None:
        """Draw the layers' weights, and set the line; the last row of `line` is its constant."""
        gain = (2 / (1 + self.slope**2)) ** 0.5
        with torch.no_grad():
            for layer in (*self.hidden, self.output):
                layer.weight.normal_(0, gain / layer.in_features**0.5, generator=generator)
                layer.bias.zero_()
            self.output.weight.mul_(OUTPUT_SHARE)
            self.output.bias.copy_(torch.from_numpy(np.ascontiguousarray(line[-1], np.float32)))
            self.line.weight.copy_(torch.from_numpy(np.ascontiguousarray(line[:-1].T, np.float32)))


def onto_basis(
    offsets: Float[np.ndarray, "b d"], basis: Float[np.ndarray, "c d"], mean: Float[np.ndarray, " d"]
) -> Float64[np.ndarray, "b c"]:
    """Return the coefficients of offsets in mm: their projection onto the components, which are orthogonal.

    The coefficient of a component of length zero is 0.
    """
    squared = np.square(basis, dtype=np.float64).sum(1)
    return (offsets - mean) @ basis.T.astype(np.float64) / np.where(squared > 0, squared, 1.0)
