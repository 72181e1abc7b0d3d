"""How large a model is, counted from its architecture alone (Table 1): no network is built for it.

A size is that of all trained weights as float32, in MB of 10⁶ bytes. It depends on how many rig parameters each network
sees and, for the dense baseline, on how many vertices it moves. So for a given set of segments, networks that see no
parameter make the smallest model, and networks that see all of them the largest.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol, runtime_checkable

START = 8  # pixels a side of the maps that the dense layers make (Fig. 3)
BYTES = 4


@runtime_checkable
class NetworkShape(Protocol):
    """What decides the size of a map network (Fig. 3), as a network's section of the configuration also has it."""

    @property
    def map_size(self) -> int:
        """Pixels a side."""

    @property
    def channels(self) -> int:
        """Channels of every convolution."""

    @property
    def hidden(self) -> tuple[int, ...]:
        """Widths of the dense layers."""


@dataclass(frozen=True)
class MapShape:
    """The shape of a map network, for stages that depend on nothing else in a network's section."""

    map_size: int
    channels: int
    hidden: tuple[int, ...]


def shape_of(section: NetworkShape) -> MapShape:
    """Return the shape of the map networks that a section of the configuration describes."""
    return MapShape(section.map_size, section.channels, section.hidden)


def megabytes(weights: int) -> float:
    """Return the size of some weights in MB."""
    return weights * BYTES / 1e6


def cnn_weights(inputs: int, shape: NetworkShape) -> int:
    """Return the number of weights of one map network of Fig. 3 that sees `inputs` rig parameters."""
    dense = sum(a * b + b for a, b in pairwise((inputs, *shape.hidden)))
    levels = (shape.map_size // START).bit_length() - 1
    depths = (shape.hidden[-1] // START**2, *[shape.channels] * (levels + 1))
    convolutions = sum(9 * a * b + b for a, b in pairwise(depths))  # 3×3, one a level and one more
    return dense + convolutions + 3 * shape.channels + 3


def dense_weights(inputs: int, vertices: int, hidden: Sequence[int]) -> int:
    """Return the number of weights of one network of the dense baseline (§5.1)."""
    return sum(a * b + b for a, b in pairwise((inputs, *hidden, 3 * vertices)))


def cnn_size_mb(
    coarse: Sequence[int], refined: Sequence[int], coarse_shape: NetworkShape, refined_shape: NetworkShape
) -> float:
    """Return the size of the full approximation; coarse, refined: how many rig parameters each network sees."""
    weights = sum(cnn_weights(inputs, coarse_shape) for inputs in coarse)
    return megabytes(weights + sum(cnn_weights(inputs, refined_shape) for inputs in refined))


def dense_size_mb(inputs: Sequence[int], vertices: Sequence[int], hidden: Sequence[int]) -> float:
    """Return the size of a dense model; inputs, vertices: how many each network sees and moves."""
    return megabytes(sum(dense_weights(j, k, hidden) for j, k in zip(inputs, vertices, strict=True)))


def dense_vertices(size_mb: float, segments: int, inputs: int, hidden: Sequence[int]) -> float:
    """Return how many vertices a dense model of this size moves if each network sees `inputs` parameters."""
    least = segments * dense_weights(inputs, 0, hidden)
    return (size_mb * 1e6 / BYTES - least) / (dense_weights(0, 1, hidden) - dense_weights(0, 0, hidden))


def dense_width(inputs: Sequence[int], vertices: Sequence[int], first: Sequence[int], size_mb: float) -> int:
    """Return the largest width of the last hidden layer for a dense model of at most `size_mb`; it may be below 1.

    inputs, vertices: as for `dense_size_mb`.
    first: the widths of the other hidden layers.
    """
    none, one = (
        sum(dense_weights(j, k, (*first, width)) for j, k in zip(inputs, vertices, strict=True)) for width in (0, 1)
    )
    return (round(size_mb * 1e6 / BYTES) - none) // (one - none)
