"""How many multiplications one pose takes, counted from a model's architecture.

A product of a weight (or of an entry of a basis, a skin weight, a bilinear share) with what it weighs counts as one.
Activations, additions and what can be folded into weights (the scale of parameters, the length of outputs) don't count,
nor does the rigid step (§3.4), which all approximations share. Map networks count as Fig. 3 draws them, without what
exact rewrites save (DEVIATIONS D14).
"""

from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from torch import nn

from replicate.approximation.cnn import START, MapNetwork
from replicate.approximation.model import SegmentedModel
from replicate.approximation.refinement import RefinedModel
from replicate.baselines.line import Line
from replicate.baselines.low_rank_dense import LowRankNetwork
from replicate.baselines.skinning.bone_network import BoneNetwork

AFFINE = 12  # multiplications of (v, 1) and a 4×3 matrix
CORNERS = 4  # pixels that a vertex reads: bilinear sampling


@runtime_checkable
class Counted(Protocol):
    """A model that counts its multiplications itself."""

    def multiplications(self) -> int:
        """Return how many multiplications one pose takes."""
        ...


def of_model(model: SegmentedModel | RefinedModel | Counted) -> int:
    """Return the multiplications of a model: its count where it has one, else those of all its networks."""
    if isinstance(model, Counted):
        return model.multiplications()
    if isinstance(model, RefinedModel):
        return of_model(model.coarse) + of_model(model.residual)
    return sum(of_network(network) for network in model.networks)


def of_network(network: nn.Module) -> int:
    """Return the multiplications of one segment's network and all its parts."""
    bases = sum(value.numel() for name, value in network.named_buffers() if name.split(".")[-1] == "basis")
    return bases + sum(_of_part(part) for part in network.modules())


def of_maps(network: MapNetwork) -> int:
    """Return the multiplications of a map network after its dense layers, with those of reading the vertices.

    They are those of a 3×3 convolution on all pixels of each upsampled map, of another and a 1×1 one on the last map,
    and of four pixels with three coordinates for each vertex.
    """
    sides = [START * 2 ** (level + 1) for level in range(len(network.upsampled))]
    layers = [*network.upsampled, network.last, network.output]
    sides += [network.map_size, network.map_size]
    convolutions = sum(layer.weight.numel() * side**2 for layer, side in zip(layers, sides, strict=True))
    return convolutions + CORNERS * 3 * len(network.pixels)


def of_blend(weights: Float[np.ndarray, "n k"]) -> int:
    """Return the multiplications of linear blend skinning: a weighted vertex and a bone's matrix for each weight."""
    return AFFINE * int(np.count_nonzero(weights))


def _of_part(part: nn.Module) -> int:
    if isinstance(part, nn.Linear | Line):
        return part.weight.numel()
    if isinstance(part, MapNetwork):
        return of_maps(part)
    if isinstance(part, LowRankNetwork):
        return part.inner.numel() + part.outer.fine.numel() + part.outer.rough.numel()
    if isinstance(part, BoneNetwork):  # (n, 4 · bones): each bone's weighted (v, 1), whose last entry is the weight
        return of_blend(part.spread[:, 3::4].numpy())
    return 0
