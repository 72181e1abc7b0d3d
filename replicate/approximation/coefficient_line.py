"""A network and a straight line to the coefficients of a basis: the PCA network's layers beside a linear skip.

V = V⁰ + mean + (c(p) + p L) B. The line starts as the ridge regression onto the coefficients and is trained along, as
in `gated_network`; the output layer's bias starts as the line's constant.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import torch
from jaxtyping import Float, Float64
from torch import nn
from torch.nn import functional

from replicate.approximation.gated_network import OUTPUT_SHARE


class CoefficientsBesideLine(nn.Module):
    """(b, m) scaled parameters → (b, k, 3) offsets in mm, in the span of a basis.

    basis: (c, 3k) components; mean: (3k,); both of float32, which are not trained. hidden: widths of the layers, each
    followed by a leaky ReLU of that slope.
    """

    def __init__(self, inputs: int, basis: torch.Tensor, mean: torch.Tensor, hidden: Sequence[int], slope: float):
        super().__init__()
        self.hidden = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise((inputs, *hidden)))
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

    A component of length zero, of samples that have fewer, has the coefficient 0.
    """
    squared = np.square(basis, dtype=np.float64).sum(1)
    return (offsets - mean) @ basis.T.astype(np.float64) / np.where(squared > 0, squared, 1.0)
