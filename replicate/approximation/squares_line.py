"""A line in more than the parameters: offsets that are linear in p, |p| and p², the features of ridge regression."""

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float
from torch import nn

from replicate.approximation.linear_skip import Line
from replicate.approximation.model import SegmentedModel
from replicate.approximation.segments import Segment

FEATURES = 3  # of each parameter


class SquaresLine(nn.Module):
    """(b, j) scaled parameters → (b, k, 3) offsets: a line in (p, |p|, p²), 3j features.

    `polynomial_fits.explicit_features` has the same features for the fit.
    """

    def __init__(self, inputs: int, vertices: int):
        super().__init__()
        self.line = Line(FEATURES * inputs, vertices)

    def forward(self, params: Float[torch.Tensor, "b j"]) -> Float[torch.Tensor, "b k 3"]:
        return self.line(torch.cat([params, params.abs(), params.square()], dim=1))


def squares_model(
    segments: Sequence[Segment], weights: Sequence[Float[np.ndarray, "_ _"]], scale: np.ndarray, vertex_count: int
) -> SegmentedModel:
    """Return the model of fits on p, |p| and p²: one matrix a segment.

    weights: a segment's are (3j + 1, 3k), the constant's row last. scale: (m,), what parameters are divided by.
    """
    networks = []
    for segment, weight in zip(segments, weights, strict=True):
        network = SquaresLine(len(segment.parameters), len(segment.vertices))
        network.line.weight.copy_(torch.from_numpy(np.ascontiguousarray(weight[:-1])))
        network.line.bias.copy_(torch.from_numpy(np.ascontiguousarray(weight[-1])))
        networks.append(network)
    return SegmentedModel(networks, segments, scale, [1.0] * len(networks), vertex_count)
