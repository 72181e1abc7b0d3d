"""The coarse approximation: for each segment a small CNN from rig parameters to a deformation map (§3.1, §3.5, Fig. 3).

`MapNetwork.maps` follows the figure layer by layer. Training and inference use `forward`, the same function rearranged:
nearest upsampling and the 3×3 convolution after it become one transposed convolution, and the maps are sampled before
the last 1×1 convolution, not after it. Both are exact, since all of these are linear.
"""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import cast

import numpy as np
import torch
from jaxtyping import Float
from torch import nn
from torch.nn import functional

from replicate.approximation.deformation_map import bilinear, sample
from replicate.approximation.model import SegmentedModel, load_model, save_model
from replicate.approximation.segments import Segment
from replicate.config import START, CoarseConfig, RefinementConfig
from replicate.kernels.map_kernel import Grid, MapOffsets
from replicate.kernels.pixel_kernel import layers_of, places
from replicate.kernels.vector_code import CHANNELS


class MapNetwork(nn.Module):
    """f(p; θ) of Fig. 3 and the sampling g: (b, j) scaled parameters → (b, k, 3) offsets of one segment.

    inputs: j.
    uv: (k, 2), where the segment's vertices read the map.
    map_size: pixels a side, 8·2^levels.
    channels: those of every convolution.
    hidden: widths of the dense layers; the last is reshaped to 8×8 pixels with hidden[-1] / 64 channels.
    slope: that of the leaky ReLUs, which follow all layers but the last dense one and the output.
    """

    pixels: torch.Tensor
    shares: torch.Tensor

    def __init__(self, inputs: int, uv: np.ndarray, map_size: int, channels: int, hidden: Sequence[int], slope: float):
        super().__init__()
        self.slope, self.map_size = slope, map_size
        widths = (inputs, *hidden)
        self.dense = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise(widths))
        levels = (map_size // START).bit_length() - 1
        depths = [hidden[-1] // START**2] + [channels] * levels
        layers = [nn.Conv2d(a, channels, 3, padding=1) for a in depths[:-1]]
        self.upsampled = cast(Sequence[nn.Conv2d], nn.ModuleList(layers))
        self.last = nn.Conv2d(depths[-1], channels, 3, padding=1)
        self.output = nn.Conv2d(channels, 3, 1)
        grid = bilinear(uv, map_size)
        self.register_buffer("pixels", torch.from_numpy(grid.pixels), persistent=False)
        self.register_buffer("shares", torch.from_numpy(grid.weights), persistent=False)
        self._listed: tuple[torch.Tensor, Grid] | None = None

    def _start(self, params: torch.Tensor) -> torch.Tensor:
        x = params
        for layer in self.dense[:-1]:
            x = functional.leaky_relu(layer(x), self.slope)
        return self.dense[-1](x).view(len(x), START, START, -1)

    def maps(self, params: Float[torch.Tensor, "b j"]) -> Float[torch.Tensor, "b size size 3"]:
        """Return the deformation maps I_k, computed as in Fig. 3."""
        x = self._start(params).permute(0, 3, 1, 2)
        for layer in self.upsampled:
            x = functional.leaky_relu(layer(functional.interpolate(x, scale_factor=2, mode="nearest")), self.slope)
        return self.output(functional.leaky_relu(self.last(x), self.slope)).permute(0, 2, 3, 1)

    def forward(self, params: Float[torch.Tensor, "b j"]) -> Float[torch.Tensor, "b k 3"]:
        """Return the offsets that the vertices read from the maps."""
        if params.device.type != "cpu" or self.last.out_channels != CHANNELS or self.dense[-1].out_features > 1024:
            return sample(self.maps(params), self.pixels, self.shares)
        convolutions = [weight for layer in (*self.upsampled, self.last) for weight in (layer.weight, layer.bias)]
        output = (self.output.weight[:, :, 0, 0], self.output.bias)
        start = self._start(params)
        return MapOffsets.apply(start, self.slope, self._grid(), *convolutions, *output)

    def _grid(self) -> Grid:
        """Return how the vertices read the map; cached for as long as `pixels` is the same tensor."""
        if self._listed is None or self._listed[0] is not self.pixels:
            pixels = self.pixels.numpy()
            upper = places(*np.divmod(pixels[:, 0], self.map_size), self.map_size)
            layers = layers_of(pixels, self.map_size, START)
            self._listed = self.pixels, Grid(upper, self.shares.numpy(), layers)
        return self._listed[1]


def make_network(segment: Segment, facts: dict) -> MapNetwork:
    """Return a network for a segment; facts: map_size, channels, hidden, leaky_slope."""
    shape = (facts["map_size"], facts["channels"], tuple(facts["hidden"]), facts["leaky_slope"])
    return MapNetwork(len(segment.parameters), segment.uv, *shape)


def shape_facts(config: CoarseConfig | RefinementConfig) -> dict:
    """Return the part of a configuration that `make_network` needs, JSON-ready."""
    return {
        "map_size": config.map_size,
        "channels": config.channels,
        "hidden": list(config.hidden),
        "leaky_slope": config.leaky_slope,
    }


def save(model: SegmentedModel, folder: Path, config: CoarseConfig | RefinementConfig) -> None:
    """Write a coarse or refinement model to a folder."""
    save_model(model, folder, shape_facts(config))


def load_coarse(folder: Path) -> SegmentedModel:
    """Read a coarse model; raise InputError if there is none."""
    return load_model(folder, make_network)
