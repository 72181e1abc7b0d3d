"""What the fast evaluation of one map network needs, worked out once: folded weights, and the pixels that matter.

A vertex reads four pixels of the last map; a 3×3 convolution needs the nine around each of these, an upsampled pixel
the 2×2 that it shows. So from the last layer to the first each layer has a list of pixels that anything reads, and the
others are never computed. On a refinement square, which holds a hundred vertices on 64×64 pixels, these are few.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from replicate.approximation.cnn import START, MapNetwork
from replicate.approximation.kernels.map_kernel import fold
from replicate.approximation.kernels.vector_code import CHANNELS
from replicate.inference.pixel_kernel import STEP, TILE

PARITIES = 4


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
    side = network.map_size
    needed = _read_pixels(network)
    layers = [_last_layer(network, needed, side)]
    needed = _grown(needed)
    depths = [depth] + [CHANNELS] * len(network.upsampled)
    for level in reversed(range(len(network.upsampled))):
        side //= 2
        layer = network.upsampled[level]
        layers.insert(0, _upsampled_layer(layer, needed, side, depths[level]))
        needed = _shown(needed)
    rows, columns = np.indices((START, START)).reshape(2, -1)
    numbers = [(START * 2**level + 2) ** 2 * d for level, d in enumerate(depths)]
    side = network.map_size
    upper = network.pixels.numpy()[:, 0]
    output = network.output
    return MapPlan(
        parameters.astype(np.int64),
        tuple(np.ascontiguousarray(weight, np.float32) for weight in weights),
        tuple(biases),
        _flat(rows, columns, START, depth),
        depth,
        *zip(*layers, strict=True),
        np.array([*numbers, (side + 2) ** 2 * CHANNELS], np.int64),
        _flat(upper // side, upper % side, side, CHANNELS),
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


def _last_layer(network: MapNetwork, needed: np.ndarray, side: int) -> tuple[np.ndarray, ...]:
    rows, columns = np.nonzero(needed)
    places = _whole_tiles(_flat(rows, columns, side, CHANNELS))
    row, column = np.indices((3, 3)).reshape(2, 1, 9) - 1
    offsets = (row * (side + 2) + column) * CHANNELS
    taps = np.ascontiguousarray(network.last.weight.detach().numpy().transpose(2, 3, 1, 0)).ravel()
    bias = network.last.bias.detach().numpy()
    return taps, bias, offsets.astype(np.int32), places, places, np.array([len(places)])


def _upsampled_layer(layer, needed: np.ndarray, side: int, depth: int) -> tuple[np.ndarray, ...]:
    """Return the layer from side² pixels of some depth to those of the (2·side)² that are needed."""
    p, q, t, u = np.indices((2, 2, 2, 2)).reshape(4, 4, 4)
    offsets = ((t + p - 1) * (side + 2) + u + q - 1) * depth
    sources, targets = [], []
    for k in range(PARITIES):
        rows, columns = np.nonzero(needed[p[k, 0] :: 2, q[k, 0] :: 2])
        sources.append(_whole_tiles(_flat(rows, columns, side, depth)))
        targets.append(_whole_tiles(_flat(2 * rows + p[k, 0], 2 * columns + q[k, 0], 2 * side, CHANNELS)))
    ends = np.cumsum([len(places) for places in sources])
    taps, bias = fold(layer.weight.detach().numpy())[:, :, :depth].ravel(), layer.bias.detach().numpy()
    return taps, bias, offsets.astype(np.int32), np.concatenate(sources), np.concatenate(targets), ends


def _read_pixels(network: MapNetwork) -> Bool[np.ndarray, "s s"]:
    """Return which pixels of the last map a vertex reads."""
    read = np.zeros(network.map_size**2, bool)
    read[network.pixels.numpy().ravel()] = True  # those of share zero, too: what isn't computed may be anything
    return read.reshape(network.map_size, -1)


def _grown(needed: Bool[np.ndarray, "s s"]) -> Bool[np.ndarray, "s s"]:
    """Return the pixels that a 3×3 convolution reads to give some pixels."""
    padded = np.pad(needed, 1)
    n = len(needed)
    return np.any([padded[r : r + n, c : c + n] for r in range(3) for c in range(3)], axis=0)


def _shown(needed: Bool[np.ndarray, "s s"]) -> Bool[np.ndarray, "h h"]:
    """Return the pixels of an image of half the side that a 3×3 convolution on the upsampled one reads."""
    half = len(needed) // 2
    return _grown(needed).reshape(half, 2, half, 2).any(axis=(1, 3))


def _flat(rows: np.ndarray, columns: np.ndarray, side: int, depth: int) -> Int[np.ndarray, " p"]:
    """Return where pixels lie in an image with a border."""
    return np.asarray(((rows + 1) * (side + 2) + columns + 1) * depth, np.int32)


def _whole_tiles(places: Int[np.ndarray, " p"]) -> Int[np.ndarray, " q"]:
    """Return a list of whole tiles: its last pixel is computed as often as the last tile needs."""
    return np.concatenate([places, np.repeat(places[-1:], -len(places) % TILE)])
