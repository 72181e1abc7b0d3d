"""A gated network with a linear skip: products of linear functions of the parameters, added to a straight line.

Each layer is h = silu(x U) ∘ (x V) (the gated linear units of Dauphin et al. 2017 and Shazeer 2020): a product of two
linear functions, as in rigs when controls combine. The skip is a straight line from parameters to outputs, which starts
as the least squares fit and is trained with the layers. Products of many parameters grow without bounds where training
saw nothing: beyond the range of a parameter, or where many are large at once. So the parameters that the layers see,
and the layers' outputs, are clipped to the ranges that training has seen, and only the line goes on.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import cast

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import nn
from torch.nn import functional

SLOPE = 0.2  # of leaky ReLUs, as in the paper's networks
OUTPUT_SHARE = 0.05  # of the usual size of an output layer's weights: the network starts as the line


class GatedNetwork(nn.Module):
    """(b, j) scaled parameters → (b, d) outputs: layers of the widths `hidden`, beside a line.

    gated: False for leaky ReLUs in place of the products.
    line: False for no skip; both options serve to measure what the pieces are worth.
    lowest, highest: (j,), the bounds of scaled parameters for the layers; `bound` sets them.
    least_k, most_k: (h_k,), the bounds of the outputs of layer k; `limit` sets them after training.
    """

    lowest: torch.Tensor
    highest: torch.Tensor

    def __init__(self, inputs: int, hidden: Sequence[int], outputs: int, gated: bool = True, line: bool = True):
        super().__init__()
        self.is_gated = gated
        layers = [nn.Linear(a, (1 + gated) * b) for a, b in pairwise((inputs, *hidden))]
        self.layers = cast(Sequence[nn.Linear], nn.ModuleList(layers))
        self.output = nn.Linear(hidden[-1], outputs)
        self.line = nn.Linear(inputs, outputs, bias=False) if line else None
        self.register_buffer("lowest", -torch.ones(inputs))
        self.register_buffer("highest", torch.ones(inputs))
        for k, width in enumerate(hidden):
            self.register_buffer(f"least_{k}", torch.full((width,), -torch.inf))
            self.register_buffer(f"most_{k}", torch.full((width,), torch.inf))
        self.is_limited = False  # whether `limit` has set them
        self.rest: torch.Tensor | None = None  # scaled parameters at which outputs are kept at zero, in training

    @property
    def limits(self) -> list[tuple[torch.Tensor, torch.Tensor]]:
        """The bounds of each layer's outputs."""
        return [(getattr(self, f"least_{k}"), getattr(self, f"most_{k}")) for k in range(len(self.layers))]

    def forward(self, params: Float[torch.Tensor, "b j"]) -> Float[torch.Tensor, "b d"]:
        if self.rest is None:
            return self._outputs(params)
        both = self._outputs(torch.cat([params, self.rest.to(params)[None]]))
        return both[:-1] - both[-1:]

    def _outputs(self, params: Float[torch.Tensor, "b j"]) -> Float[torch.Tensor, "b d"]:
        x = _within(params, self.lowest, self.highest)
        for layer, (least, most) in zip(self.layers, self.limits, strict=True):
            x = self._after(layer(x))
            if self.is_limited:
                x = _within(x, least, most)
        return self.output(x) if self.line is None else self.output(x) + self.line(params)

    def _after(self, sums: torch.Tensor) -> torch.Tensor:
        return _multiply(sums) if self.is_gated else functional.leaky_relu(sums, SLOPE)

    def start(self, line: Float[np.ndarray, "i d"], generator: torch.Generator) -> None:
        """Draw the weights, and set the line; the last row of `line` is its constant.

        A network without a skip starts at that constant.
        """
        with torch.no_grad():
            for layer in (*self.layers, self.output):
                reach = layer.in_features**-0.5
                layer.weight.uniform_(-reach, reach, generator=generator)
                layer.bias.uniform_(-reach, reach, generator=generator)
            self.output.weight.mul_(OUTPUT_SHARE)
            self.output.bias.copy_(torch.from_numpy(np.ascontiguousarray(line[-1], np.float32)))
            if self.line is not None:
                self.line.weight.copy_(torch.from_numpy(np.ascontiguousarray(line[:-1].T, np.float32)))

    def bound(self, params: Float[np.ndarray, "s j"]) -> None:
        """Set the bounds of scaled parameters to the range of some samples, rounded to 16 bits."""
        for bound, values in ((self.lowest, params.min(axis=0)), (self.highest, params.max(axis=0))):
            bound.copy_(torch.from_numpy(np.asarray(values, np.float32)).half())

    def limit(self, params: Float[np.ndarray, "s j"]) -> None:
        """Set the bounds of each layer's outputs to their range over some samples, rounded to 16 bits."""
        with torch.no_grad():
            x = _within(torch.from_numpy(np.asarray(params, np.float32)), self.lowest, self.highest)
            for layer, (least, most) in zip(self.layers, self.limits, strict=True):
                x = self._after(layer(x))
                least.copy_(x.amin(dim=0).half())
                most.copy_(x.amax(dim=0).half())
                x = _within(x, least, most)
        self.is_limited = True

    def settle(self) -> None:
        """Put what keeps the outputs at zero at rest into the bias, when training is over."""
        if self.rest is not None:
            with torch.no_grad():
                self.output.bias.sub_(self._outputs(self.rest[None])[0])
            self.rest = None

    def multiplications(self) -> int:
        """Return how many multiplications one pose takes."""
        return sum(weight.numel() for name, weight in self.named_parameters() if name.endswith("weight"))


def _within(values: torch.Tensor, least: torch.Tensor, most: torch.Tensor) -> torch.Tensor:
    return torch.minimum(torch.maximum(values, least), most)


def _multiply(both: torch.Tensor) -> torch.Tensor:
    gate, value = both.chunk(2, dim=1)
    return functional.silu(gate) * value


# The networks of our approximation: one for each region, of the controls that move it, or one for all regions.


class RegionalNetworks(nn.Module):
    """(b, m) scaled parameters → (b, d) coefficients: the outputs of all networks, one after the other.

    seen: (j,) for each network, which of the m parameters it sees.
    """

    def __init__(self, networks: Sequence[GatedNetwork], seen: Sequence[Int[np.ndarray, " _"]]):
        super().__init__()
        self.networks = cast(Sequence[GatedNetwork], nn.ModuleList(networks))
        for k, parameters in enumerate(seen):
            self.register_buffer(f"seen_{k}", torch.from_numpy(np.array(parameters, np.int64)), persistent=False)

    @property
    def seen(self) -> list[torch.Tensor]:
        """Which parameters each network sees."""
        return [getattr(self, f"seen_{k}") for k in range(len(self.networks))]

    def forward(self, params: Float[torch.Tensor, "b m"]) -> Float[torch.Tensor, "b d"]:
        pairs = zip(self.networks, self.seen, strict=True)
        return torch.cat([network(params[:, parameters]) for network, parameters in pairs], dim=1)

    def multiplications(self) -> int:
        """Return how many multiplications one pose takes."""
        return sum(network.multiplications() for network in self.networks)


def fresh_networks(
    seen: Sequence[Int[np.ndarray, " _"]], hidden: Sequence[int], outputs: Sequence[int], gated: bool, line: bool
) -> RegionalNetworks:
    """Return untrained networks, one for each entry of `seen`.

    seen: which parameters each network sees.
    hidden: widths of the layers.
    outputs: how many coefficients each region has; a single network gives those of all regions.
    gated, line: as for `GatedNetwork`.
    """
    widths = outputs if len(seen) > 1 else [sum(outputs)]
    networks = [
        GatedNetwork(len(parameters), hidden, width, gated, line)
        for parameters, width in zip(seen, widths, strict=True)
    ]
    return RegionalNetworks(networks, seen)
