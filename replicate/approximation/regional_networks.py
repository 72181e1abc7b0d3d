"""The networks of our approximation: one for each region, of the controls that move it, or one for all regions.

A region's network sees nothing of the controls that don't move the region, as a segment's network in the paper (§3.1),
so that it can't learn from a few thousand samples that an ear depends on the mouth.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import nn

from replicate.approximation.gated_network import GatedNetwork


class RegionalNetworks(nn.Module):
    """(b, m) scaled parameters → (b, d) coefficients: what the networks give, one after the other.

    seen: for each network, which of the m parameters it sees, (j,).
    """

    def __init__(self, networks: Sequence[GatedNetwork], seen: Sequence[Int[np.ndarray, " _"]]):
        super().__init__()
        self.networks = nn.ModuleList(networks)
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
    """Return networks without trained weights: as many as there are entries in `seen`.

    outputs: how many coefficients each region has. A single network gives those of all regions.
    """
    widths = outputs if len(seen) > 1 else [sum(outputs)]
    networks = [
        GatedNetwork(len(parameters), hidden, width, gated, line)
        for parameters, width in zip(seen, widths, strict=True)
    ]
    return RegionalNetworks(networks, seen)
