"""What the fast evaluation of one map network needs, worked out once: folded weights, and the pixels that matter
(`kernels.pixel_lists`).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from torch import nn

from replicate.approximation.cnn import START, MapNetwork
from replicate.approximation.kernels.map_kernel import fold
from replicate.approximation.kernels.pixel_kernel import STEP
from replicate.approximation.kernels.pixel_lists import PARITIES, LayerPixels, layers_of, places
from replicate.approximation.kernels.vector_code import CHANNELS


class MapPlan(NamedTuple):
    """One network of j parameters and k vertices. Images are flat, [row, column, channel], with a border of zeros.

    Of the dense layers: parameters (j,) which of all; weights [in, out] and biases, the scale of parameters folded in;
    starts (64,), where the pixels of the last one's output lie in the first image, and depth, its channels, with zeros.
    Of the convolutions, a tuple over layers each; all but the last show an upsampled image: taps, flat, [parity, tap,
    channel in, 16]; their biases; offsets [parity, tap] of the taps; sources and targets, the pixels in lists of whole
    tiles; ends (4,), where each parity's part of the lists ends; sizes (layers + 1,), numbers in each image.
    Of the reading: pixels (k,) and below, where the upper and the lower pair of pixels lie; shares (k, 4); weight
    (3, 16) and bias (3,) of the 1×1 convolution, the length of offsets in mm folded in; vertices (k,) of the mesh.
    slope: of the leaky ReLUs.
    """

    parameters: np.ndarray
    weights: tuple[np.ndarray, ...]
    weight_biases: tuple[np.ndarray, ...]
    starts: np.ndarray
    depth: int
    taps: tuple[np.ndarray, ...]
    biases: tuple[np.ndarray, ...]
    offsets: tuple[np.ndarray, ...]
    sources: tuple[np.ndarray, ...]
    targets: tuple[np.ndarray, ...]
    ends: tuple[np.ndarray, ...]
    sizes: np.ndarray
    pixels: np.ndarray
    below: int
    shares: np.ndarray
    weight: np.ndarray
    bias: np.ndarray
    vertices: np.ndarray
    slope: np.float32


def has_plan(network: MapNetwork) -> bool:
    """Return whether the kernels take a network: of 16 channels, and no more in what the dense layers make."""
    return network.last.out_channels == CHANNELS and network.dense[-1].out_features <= CHANNELS * START**2


def plan_maps(
    network: MapNetwork,
    parameters: Int[np.ndarray, " j"],
    vertices: Int[np.ndarray, " k"],
    scale: Float[np.ndarray, " m"],
    length_mm: float,
) -> MapPlan:
    """Return the plan of one segment's network.

    parameters: those that it sees. vertices: those that it moves. scale: what all parameters are divided by. length_mm:
    what its outputs are multiplied with.
    """
    weights = [layer.weight.detach().numpy().T for layer in network.dense]
    weights[0] = weights[0] / scale[parameters][:, None]
    biases = [layer.bias.detach().numpy() for layer in network.dense]
    weights[-1], biases[-1] = (_whole_steps(values) for values in (weights[-1], biases[-1]))
    depth = len(biases[-1]) // START**2
    *upsampled, last = layers_of(network.pixels.numpy(), network.map_size, START, depth)
    depths = [depth] + [CHANNELS] * len(network.upsampled)
    layers = [
        _upsampled_layer(network.upsampled[level], pixels, START * 2**level, depths[level])
        for level, pixels in enumerate(upsampled)
    ]
    layers.append(_last_layer(network, last))
    rows, columns = np.indices((START, START)).reshape(2, -1)
    numbers = [(START * 2**level + 2) ** 2 * d for level, d in enumerate(depths)]
    side = network.map_size
    upper = network.pixels.numpy()[:, 0]
    output = network.output
    return MapPlan(
        parameters.astype(np.int64),
        tuple(np.ascontiguousarray(weight, np.float32) for weight in weights),
        tuple(biases),
        places(rows, columns, START, depth),
        depth,
        *zip(*layers, strict=True),
        np.array([*numbers, (side + 2) ** 2 * CHANNELS], np.int64),
        places(upper // side, upper % side, side),
        (side + 2) * CHANNELS,
        network.shares.numpy(),
        output.weight.detach().numpy()[:, :, 0, 0] * np.float32(length_mm),
        output.bias.detach().numpy() * np.float32(length_mm),
        vertices.astype(np.int64),
        np.float32(network.slope),
    )


def _whole_steps(values: np.ndarray) -> np.ndarray:
    """Return what the last dense layer makes, [..., pixel and channel], with channels of zeros up to whole steps."""
    split = values.reshape(*values.shape[:-1], START**2, -1)
    more = [(0, 0)] * (split.ndim - 1) + [(0, -split.shape[-1] % STEP)]
    return np.pad(split, more).reshape(*values.shape[:-1], -1)


def _last_layer(network: MapNetwork, pixels: LayerPixels) -> tuple[np.ndarray, ...]:
    row, column = np.indices((3, 3)).reshape(2, 1, 9) - 1
    offsets = (row * (network.map_size + 2) + column) * CHANNELS
    taps = np.ascontiguousarray(network.last.weight.detach().numpy().transpose(2, 3, 1, 0)).ravel()
    bias = network.last.bias.detach().numpy()
    return taps, bias, offsets.astype(np.int32), *pixels[:3]


def _upsampled_layer(layer: nn.Conv2d, pixels: LayerPixels, side: int, depth: int) -> tuple[np.ndarray, ...]:
    """Return the layer from side² pixels of some depth to those of the (2·side)² that are needed."""
    p, q, t, u = np.indices((2, 2, 2, 2)).reshape(4, PARITIES, 4)
    offsets = ((t + p - 1) * (side + 2) + u + q - 1) * depth
    taps, bias = fold(layer.weight.detach().numpy())[:, :, :depth].ravel(), layer.bias.detach().numpy()
    return taps, bias, offsets.astype(np.int32), *pixels[:3]
