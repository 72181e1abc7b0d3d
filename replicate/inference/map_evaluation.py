"""Map networks for one pose at a time on one thread: only the pixels that `MapPlan` lists are computed."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Float, Float32, Int
from numba import njit
from torch import nn

from replicate.approximation.cnn import START, MapNetwork
from replicate.approximation.model import SegmentedModel
from replicate.base.jit_cache import kept
from replicate.inference.products import NOTHING, Work, add_products, of_layers, total, without_loss
from replicate.kernels.map_kernel import REORDER, fold, read_vertex
from replicate.kernels.pixel_kernel import PARITIES, STEP, TILE, LayerPixels, layers_of, multiply_pixels, places
from replicate.kernels.vector_code import CHANNELS

# The plan of one map network, made once: folded weights, and the pixels that vertices need (`kernels.pixel_kernel`).


class MapPlan(NamedTuple):
    """One network of j parameters and k vertices. Images are flat, [row, column, channel], with a border of zeros.

    Of the dense layers:
    parameters: (j,), which of all parameters the network sees.
    weights: [in, out] of each layer, with the scale of parameters folded in.
    weight_biases: of each layer.
    starts: (64,), where the pixels of the last layer's output begin in the first image.
    depth: channels of the first image, with those of zeros that fill it up.
    Of the convolutions, one entry a layer; all but the last layer make an upsampled image:
    taps: flat, [parity, tap, channel in, 16].
    biases: of each layer.
    offsets: [parity, tap], from a pixel to the taps' places.
    sources, targets: the pixels that are read and written, in lists of whole tiles.
    ends: (4,), where each parity's part of the lists ends.
    sizes: (layers + 1,), how many numbers each image has.
    Of the reading of vertices:
    pixels: (k,), where the upper pair of pixels lies.
    below: how much further the lower pair lies.
    shares: (k, 4), of the four pixels.
    weight, bias: (3, 16) and (3,), of the 1×1 convolution, with the length of offsets in mm folded in.
    vertices: (k,) of the mesh.
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
    """Return whether the kernels can evaluate a network: it has 16 channels, and no more come from the dense layers."""
    return network.last.out_channels == CHANNELS and network.dense[-1].out_features <= CHANNELS * START**2


def plan_maps(
    network: MapNetwork,
    parameters: Int[np.ndarray, " j"],
    vertices: Int[np.ndarray, " k"],
    scale: Float[np.ndarray, " m"],
    length_mm: float,
) -> MapPlan:
    """Return the plan of one segment's network.

    network: the segment's.
    parameters: those that it sees.
    vertices: those that it moves.
    scale: what all parameters are divided by.
    length_mm: what its outputs are multiplied by.
    """
    # dense layers, the scale of parameters folded in
    weights = [layer.weight.detach().numpy().T for layer in network.dense]
    weights[0] = weights[0] / scale[parameters][:, None]
    biases = [layer.bias.detach().numpy() for layer in network.dense]
    weights[-1], biases[-1] = (_whole_steps(values) for values in (weights[-1], biases[-1]))
    depth = len(biases[-1]) // START**2
    # convolutions, at the pixels that the vertices need
    *upsampled, last = layers_of(network.pixels.numpy(), network.map_size, START, depth)
    depths = [depth] + [CHANNELS] * len(network.upsampled)
    layers = [
        _upsampled_layer(network.upsampled[level], pixels, START * 2**level, depths[level])
        for level, pixels in enumerate(upsampled)
    ]
    layers.append(_last_layer(network, last))
    rows, columns = np.indices((START, START)).reshape(2, -1)
    sizes = [(START * 2**level + 2) ** 2 * d for level, d in enumerate(depths)]
    # the reading, the length of offsets folded in
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
        np.array([*sizes, (side + 2) ** 2 * CHANNELS], np.int64),
        places(upper // side, upper % side, side),
        (side + 2) * CHANNELS,
        network.shares.numpy(),
        output.weight.detach().numpy()[:, :, 0, 0] * np.float32(length_mm),
        output.bias.detach().numpy() * np.float32(length_mm),
        vertices.astype(np.int64),
        np.float32(network.slope),
    )


def _whole_steps(values: np.ndarray) -> np.ndarray:
    """Return weights of the last dense layer, [..., pixel and channel], with channels of zeros up to whole steps."""
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
    """Return the layer that upsamples side² pixels of some depth to those of (2·side)² that are needed."""
    p, q, t, u = np.indices((2, 2, 2, 2)).reshape(4, PARITIES, 4)
    offsets = ((t + p - 1) * (side + 2) + u + q - 1) * depth
    taps, bias = fold(layer.weight.detach().numpy())[:, :, :depth].ravel(), layer.bias.detach().numpy()
    return taps, bias, offsets.astype(np.int32), *pixels[:3]


PIXELS = START**2


@kept
@njit(error_model="numpy", fastmath=REORDER, nogil=True)
@no_type_check
def _read(image, pixels, below, shares, weight, bias, vertices, out):
    """Add to `out` (n, 3) what vertices read bilinearly from an image, through the 1×1 convolution."""
    for i in range(len(pixels)):
        at = pixels[i]
        upper, lower = image[at : at + 2 * CHANNELS], image[at + below : at + below + 2 * CHANNELS]
        x, y, z = read_vertex(upper, lower, shares[i], weight)
        vertex = vertices[i]
        out[vertex, 0] += x + bias[0]
        out[vertex, 1] += y + bias[1]
        out[vertex, 2] += z + bias[2]


@kept
@njit(error_model="numpy", nogil=True)
@no_type_check
def _add_offsets(program, params, images, sums, rows, out):
    """Add to `out` (n, 3) the offsets of all networks' vertices, mm, for raw rig parameters (m,).

    images: scratch of `program.memory` zeros, whose borders stay zero. sums: scratch for layers, (2, widest). rows:
    scratch for the indices of the widest input.
    """
    facts, numbers, places = program.facts, program.numbers, program.places
    f, weight, n, p = NOTHING, NOTHING, NOTHING, NOTHING  # how far each of the arrays has been read
    for network in range(len(program.slopes)):
        slope = program.slopes[network]
        # the dense layers
        inputs, layers = facts[f], facts[f + 1]
        x = params[places[p : p + inputs]]
        f, p = f + 2, p + inputs
        for layer in range(layers):
            width = facts[f]
            y = sums[layer % 2, :width]
            y[:] = numbers[n : n + width]
            add_products(x, program.weights, weight, width, y, rows)
            if layer + 1 < layers:
                for k in range(width):
                    y[k] = max(y[k], slope * y[k])
            f, n, weight = f + 1, n + width, weight + len(x) * width
            x = y
        # their output as the first image
        channels, first_image, layers = facts[f], facts[f + 1], facts[f + 2]
        image = images[first_image:]
        for k in range(PIXELS):
            start = places[p + k]
            image[start : start + channels] = x[k * channels : (k + 1) * channels]
        f, p = f + 3, p + PIXELS
        # the convolutions, a parity of pixels after the other
        for _ in range(layers):
            shown = images[facts[f] :]
            parities, taps = facts[f + 1], facts[f + 2]
            f += 3
            block, count = taps * channels * CHANNELS, facts[f + parities - 1]
            bias = numbers[n + parities * block : n + parities * block + CHANNELS]
            sources = places[p + parities * taps : p + parities * taps + count]
            targets = places[p + parities * taps + count : p + parities * taps + 2 * count]
            first = 0
            for parity in range(parities):
                taps_here = numbers[n + parity * block : n + (parity + 1) * block]
                offsets = places[p + parity * taps : p + (parity + 1) * taps]
                for place in range(first, facts[f + parity], TILE):
                    multiply_pixels(shown, targets, image, sources, place, offsets, taps_here, channels, bias, slope)
                first = facts[f + parity]
            f, n, p = f + parities, n + parities * block + CHANNELS, p + parities * taps + 2 * count
            image, channels = shown, CHANNELS
        # the vertices, which read the last image
        count, below = facts[f], facts[f + 1]
        weights = numbers[n : n + 3 * CHANNELS].reshape(3, CHANNELS)
        n += 3 * CHANNELS
        shares = numbers[n + 3 : n + 3 + 4 * count].reshape(count, 4)
        vertices = places[p + count : p + 2 * count]
        _read(image, places[p : p + count], below, shares, weights, numbers[n : n + 3], vertices, out)
        f, n, p = f + 2, n + 3 + 4 * count, p + 2 * count


class FastMaps:
    """The map networks of a coarse or refined model, side by side, one pose at a time."""

    def __init__(self, plans: Sequence[MapPlan], halves: bool = False):
        self._plans, self._program = tuple(plans), program_of(plans, halves)
        self._images = np.zeros(self._program.memory, np.float32)
        self._sums = np.zeros((2, self._program.widest), np.float32)
        widest = max(self._program.widest, *(len(plan.parameters) for plan in plans), 0)
        self._rows = np.zeros(widest, np.int64)

    def place(self, params: Float32[np.ndarray, " m"], out: Float32[np.ndarray, "n 3"]) -> None:
        """Add all networks' offsets (mm) for raw rig parameters to `out`."""
        _add_offsets(self._program, params, self._images, self._sums, self._rows, out)

    def work(self, params: Float32[np.ndarray, " m"]) -> Work:
        """Return what a pose, given as raw rig parameters, costs."""
        program, size = self._program, self._program.weights.itemsize
        parts = [Work(0, program.numbers.nbytes + program.places.nbytes)]
        for plan in self._plans:
            parts.append(of_layers(params[plan.parameters], [len(bias) for bias in plan.weight_biases], size))
            depths = [plan.depth, *[CHANNELS] * (len(plan.taps) - 1)]
            pixels = zip(plan.sources, plan.offsets, depths, strict=True)
            products = sum(len(places) * offsets.shape[1] * depth * CHANNELS for places, offsets, depth in pixels)
            parts.append(Work(products + len(plan.vertices) * (4 + 3) * CHANNELS, 0))
        return total(parts)


def fast_maps(models: Sequence[SegmentedModel], halves: bool = False) -> FastMaps:
    """Return the fast evaluation of models of map networks, whose offsets add."""
    plans = [
        plan_maps(network, segment.parameters, segment.vertices, model.scale.numpy(), length)
        for model in models
        for network, segment, length in zip(model.networks, model.segments, model.lengths, strict=True)
    ]
    return FastMaps(plans, halves)


# Plans of map networks in few flat arrays, read from front to back: each argument of a compiled function costs time.


class MapProgram(NamedTuple):
    """All networks' plans in the order in which the evaluation uses them.

    facts: for each network the counts of parameters and dense layers, the layers' widths, the depth of the first image
        and its place in the scratch memory, the count of convolutions; for each of these its image's place, the counts
        of parities and taps, and the ends of the parities' pixels; then the count of vertices, and `below`.
    weights: of dense layers, float32 or the bits of float16.
    numbers: for each network the dense layers' biases; the taps and the bias of each convolution; weight, bias and
        shares of the reading.
    places: for each network its parameters and starts; offsets, sources and targets of each convolution; pixels and
        vertices of the reading.
    slopes: of the networks.
    memory: how many numbers all images have.
    widest: of the dense layers.
    """

    facts: np.ndarray
    weights: np.ndarray
    numbers: np.ndarray
    places: np.ndarray
    slopes: np.ndarray
    memory: int
    widest: int


def program_of(plans: Sequence[MapPlan], halves: bool = False) -> MapProgram:
    """Return the program of some networks. halves: store dense layers as float16 even where that rounds.

    Networks share images of the same size: each reads only pixels that it has written, and borders, which none writes.
    """
    images: dict[tuple[int, int], int] = {}
    memory = 0
    for plan in plans:
        for image in enumerate(plan.sizes.tolist()):
            if image not in images:
                images[image], memory = memory, memory + image[1]
    weights = without_loss(np.concatenate([w.ravel() for plan in plans for w in plan.weights]), halves)
    return MapProgram(
        np.array([fact for plan in plans for fact in _facts(plan, images)], np.int64),
        weights,
        np.concatenate([part.ravel() for plan in plans for part in _numbers(plan)]).astype(np.float32),
        np.concatenate([part.ravel() for plan in plans for part in _places(plan)]).astype(np.int32),
        np.array([plan.slope for plan in plans], np.float32),
        memory,
        max(len(bias) for plan in plans for bias in plan.weight_biases),
    )


def _facts(plan: MapPlan, images: dict[tuple[int, int], int]) -> Iterator[int]:
    at = [images[image] for image in enumerate(plan.sizes.tolist())]
    yield from (len(plan.parameters), len(plan.weights), *(len(bias) for bias in plan.weight_biases))
    yield from (plan.depth, at[0], len(plan.taps))
    for place, offsets, ends in zip(at[1:], plan.offsets, plan.ends, strict=True):
        yield from (place, *offsets.shape, *ends.tolist())
    yield from (len(plan.vertices), plan.below)


def _numbers(plan: MapPlan) -> Iterator[np.ndarray]:
    yield from plan.weight_biases
    for taps, bias in zip(plan.taps, plan.biases, strict=True):
        yield from (taps, bias)
    yield from (plan.weight, plan.bias, plan.shares)


def _places(plan: MapPlan) -> Iterator[np.ndarray]:
    yield from (plan.parameters, plan.starts)
    for offsets, sources, targets in zip(plan.offsets, plan.sources, plan.targets, strict=True):
        yield from (offsets, sources, targets)
    yield from (plan.pixels, plan.vertices)
