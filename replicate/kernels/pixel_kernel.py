"""Vector kernels of the convolutions: 16 channels of a pixel are one vector, in LLVM's own words.

Plain loops leave it to the compiler to keep the sums in registers, and it does not. Here eight sums of 16 channels each
stay there while all taps of a kernel go by. Pixels need not be neighbours, so that a layer can leave out those that
nothing reads (below). Each has a plain twin, `…_plain`.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Bool, Int, Int32
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import Signature

from replicate.kernels.vector_code import (  # fmt: skip
    CHANNELS,
    INDEX,
    add_product,
    call,
    check_places,
    data,
    length,
    load,
    number_at,
    place_in,
    splat,
    store,
    twin_of,
    variables,
)

TILE = 8  # pixels at a time
STEP = 4  # channels at a time


@no_type_check
def multiply_pixels_plain(
    out: np.ndarray, targets: np.ndarray, image: np.ndarray, sources: np.ndarray, first: int,
    offsets: np.ndarray, taps: np.ndarray, channels: int, bias: np.ndarray, slope: float,
) -> None:  # fmt: skip
    """Write leaky_relu(bias + Σ_t image[pixel + offsets[t]] @ taps[t]) for the pixels first … first + 7 of a list.

    out, image: flat. targets, sources: int32, where each pixel is written and read. offsets: (t,) int32. taps: (t,
    channels, 16), flat. bias: (16,). slope: between 0 and 1; 1 leaves the sum as it is.
    """
    weights = taps.reshape(len(offsets), channels, CHANNELS)
    for k in range(first, first + TILE):
        total = bias.copy()
        for t in range(len(offsets)):
            for c in range(channels):
                total += image[sources[k] + offsets[t] + c] * weights[t, c]
        out[targets[k] : targets[k] + CHANNELS] = np.maximum(total, np.float32(slope) * total)


@no_type_check
def add_pixels_plain(
    out: np.ndarray, targets: np.ndarray, shift: int, image: np.ndarray, sources: np.ndarray, first: int,
    tap: np.ndarray,
) -> None:  # fmt: skip
    """Add image[source] @ tap to out[target + shift] for the pixels first … first + 7 of a list.

    A pixel that the tile has several times is added once. tap: (16, 16), flat. Other arguments as above.
    """
    for k in range(first, first + TILE):
        if not (targets[first:k] == targets[k]).any():
            at = targets[k] + shift
            for c in range(CHANNELS):
                out[at : at + CHANNELS] += image[sources[k] + c] * tap[c * CHANNELS : (c + 1) * CHANNELS]


@no_type_check
def correlate_pixels_plain(
    gradient: np.ndarray, image: np.ndarray, sources: np.ndarray, offset: int, upstream: np.ndarray,
    targets: np.ndarray, first: int, last: int,
) -> None:  # fmt: skip
    """Add Σ image[source + offset]ᵀ upstream[target] over the pixels first … last − 1 of a list to gradient (16, 16).

    image, upstream: flat. sources, targets: int32, where each pixel lies in either.
    """
    for k in range(first, last):
        a, b = sources[k] + offset, targets[k]
        for c in range(CHANNELS):
            gradient[c] += image[a + c] * upstream[b : b + CHANNELS]


def _listed(builder: ir.IRBuilder, first: ir.Value) -> list[ir.Value]:
    """Return where the pixels of a tile stand in a list."""
    return [builder.add(first, ir.Constant(INDEX, k)) for k in range(TILE)]


def _add_tap(
    builder: ir.IRBuilder, sums: Sequence[ir.Value], pixels: Sequence[ir.Value], offset: ir.Value, tap: ir.Value,
    first: ir.Value, channels: ir.Value,
) -> None:  # fmt: skip
    """Add to each pixel's sum its channels, `offset` from where it lies, times a tap whose numbers begin at `first`."""
    steps = builder.udiv(channels, ir.Constant(INDEX, STEP))
    with cgutils.for_range(builder, steps, intp=INDEX) as step:
        for k in range(STEP):
            channel = builder.add(builder.mul(step.index, ir.Constant(INDEX, STEP)), ir.Constant(INDEX, k))
            row = builder.add(first, builder.mul(channel, ir.Constant(INDEX, CHANNELS)))
            weight, at = load(builder, number_at(builder, tap, row)), builder.add(offset, channel)
            for pixel, total in zip(pixels, sums, strict=True):
                add_product(builder, total, splat(builder, builder.load(number_at(builder, pixel, at))), weight)


@twin_of(multiply_pixels_plain)
def multiply_pixels(
    typing: object, out: types.Type, targets: types.Type, image: types.Type, sources: types.Type, first: types.Type,
    offsets: types.Type, taps: types.Type, channels: types.Type, bias: types.Type, slope: types.Type,
) -> tuple[Signature, Callable]:  # fmt: skip
    """Compile `multiply_pixels_plain`; channels is a multiple of STEP."""
    check_places(targets, sources, offsets)

    def generate(context, builder, signature, args):
        kinds = signature.args
        out, targets, image, sources, offsets, taps, bias = (
            data(context, builder, kinds[k], args[k]) for k in (0, 1, 2, 3, 5, 6, 8)
        )
        channels, listed = args[7], _listed(builder, args[4])
        pixels = [number_at(builder, image, place_in(builder, sources, each)) for each in listed]
        sums, start = variables(builder, TILE), load(builder, bias)
        for total in sums:
            builder.store(start, total)
        block = builder.mul(channels, ir.Constant(INDEX, CHANNELS))
        with cgutils.for_range(builder, length(context, builder, kinds[5], args[5]), intp=INDEX) as tap:
            offset = place_in(builder, offsets, tap.index)
            _add_tap(builder, sums, pixels, offset, taps, builder.mul(tap.index, block), channels)
        fall = splat(builder, args[9])
        for each, total in zip(listed, sums, strict=True):
            value = builder.load(total)
            value = call(builder, "maxnum", value, builder.fmul(value, fall))
            store(builder, value, number_at(builder, out, place_in(builder, targets, each)))
        return context.get_dummy_value()

    index = types.int64
    signature = types.void(out, targets, image, sources, index, offsets, taps, index, bias, types.float32)
    return signature, generate


@twin_of(add_pixels_plain)
def add_pixels(
    typing: object, out: types.Type, targets: types.Type, shift: types.Type, image: types.Type, sources: types.Type,
    first: types.Type, tap: types.Type,
) -> tuple[Signature, Callable]:  # fmt: skip
    """Compile `add_pixels_plain`: all pixels of the tile are read before one is written."""
    check_places(targets, sources)

    def generate(context, builder, signature, args):
        kinds, none = signature.args, ir.Constant(INDEX, 0)
        out, targets, image, sources, tap = (data(context, builder, kinds[k], args[k]) for k in (0, 1, 3, 4, 6))
        listed = _listed(builder, args[5])
        pixels = [number_at(builder, image, place_in(builder, sources, each)) for each in listed]
        goals = [number_at(builder, out, builder.add(place_in(builder, targets, each), args[2])) for each in listed]
        sums = variables(builder, TILE)
        for goal, total in zip(goals, sums, strict=True):
            builder.store(load(builder, goal), total)
        _add_tap(builder, sums, pixels, none, tap, none, ir.Constant(INDEX, CHANNELS))
        for goal, total in zip(goals, sums, strict=True):
            store(builder, builder.load(total), goal)
        return context.get_dummy_value()

    index = types.int64
    return types.void(out, targets, index, image, sources, index, tap), generate


@twin_of(correlate_pixels_plain)
def correlate_pixels(
    typing: object, gradient: types.Type, image: types.Type, sources: types.Type, offset: types.Type,
    upstream: types.Type, targets: types.Type, first: types.Type, last: types.Type,
) -> tuple[Signature, Callable]:  # fmt: skip
    """Compile `correlate_pixels_plain`."""
    check_places(targets, sources)

    def generate(context, builder, signature, args):
        kinds = signature.args
        gradient, image, sources, upstream, targets = (
            data(context, builder, kinds[k], args[k]) for k in (0, 1, 2, 4, 5)
        )
        offset, first, last = args[3], args[6], args[7]
        for half in (range(CHANNELS // 2), range(CHANNELS // 2, CHANNELS)):
            sums = variables(builder, len(half))
            rows = [number_at(builder, gradient, ir.Constant(INDEX, k * CHANNELS)) for k in half]
            for row, total in zip(rows, sums, strict=True):
                builder.store(load(builder, row), total)
            with cgutils.for_range_slice(builder, first, last, ir.Constant(INDEX, 1), intp=INDEX, inc=True) as (k, _):
                pixel = number_at(builder, image, builder.add(place_in(builder, sources, k), offset))
                right = load(builder, number_at(builder, upstream, place_in(builder, targets, k)))
                for channel, total in zip(half, sums, strict=True):
                    left = builder.load(number_at(builder, pixel, ir.Constant(INDEX, channel)))
                    add_product(builder, total, splat(builder, left), right)
            for row, total in zip(rows, sums, strict=True):
                store(builder, builder.load(total), row)
        return context.get_dummy_value()

    index = types.int64
    signature = types.void(gradient, image, sources, index, upstream, targets, index, index)
    return signature, generate


# Which pixels of a network's images matter: those that a vertex reads, and those that these are made from.

PARITIES = 4


class LayerPixels(NamedTuple):
    """The pixels that a layer writes, in a list for each parity of row and column if it upsamples, else in one.

    sources, targets: where they lie in the image that is read and in the one that is written, in whole tiles. ends:
    where each list ends. counts: how many of a list are pixels; what follows them repeats the last one. made: the
    targets of all, row by row.
    """

    sources: np.ndarray
    targets: np.ndarray
    ends: np.ndarray
    counts: np.ndarray
    made: np.ndarray


def layers_of(pixels: Int[np.ndarray, "k 4"], size: int, start: int, depth: int = CHANNELS) -> list[LayerPixels]:
    """Return the pixels of each layer, the first first: the upsampling ones, and the last convolution.

    pixels: that vertices read of the last map. size, start: pixels a side of the last and of the first image. depth:
    the channels of the first image as it is stored; all others have 16.
    """
    needed = np.zeros(size**2, bool)
    needed[pixels.ravel()] = True  # those of share zero, too: what isn't computed may be anything
    needed = needed.reshape(size, size)
    here = places(*np.nonzero(needed), size)
    layers, needed = [_layer_pixels([(here, here)], here)], grown(needed)
    while size > start:
        size //= 2
        channels, parts = depth if size == start else CHANNELS, []
        for p, q in np.ndindex(2, 2):
            rows, columns = np.nonzero(needed[p::2, q::2])
            written = places(2 * rows + p, 2 * columns + q, 2 * size)
            parts.append((places(rows, columns, size, channels), written))
        layers.insert(0, _layer_pixels(parts, places(*np.nonzero(needed), 2 * size)))
        needed = grown(needed).reshape(size, 2, size, 2).any(axis=(1, 3))
    return layers


def grown(needed: Bool[np.ndarray, "s s"]) -> Bool[np.ndarray, "s s"]:
    """Return the pixels that a 3×3 convolution reads to give some pixels."""
    padded = np.pad(needed, 1)
    n = len(needed)
    return np.any([padded[r : r + n, c : c + n] for r in range(3) for c in range(3)], axis=0)


def places(
    rows: Int[np.ndarray, " p"], columns: Int[np.ndarray, " p"], size: int, depth: int = CHANNELS
) -> Int32[np.ndarray, " p"]:
    """Return where pixels lie in an image with a border."""
    return np.asarray(((rows + 1) * (size + 2) + columns + 1) * depth, np.int32)


def _layer_pixels(parts: list[tuple[np.ndarray, np.ndarray]], made: np.ndarray) -> LayerPixels:
    whole = [tuple(np.concatenate([each, np.repeat(each[-1:], -len(each) % TILE)]) for each in part) for part in parts]
    sources, targets = (np.concatenate([part[side] for part in whole]) for side in (0, 1))
    ends = np.cumsum([len(part[0]) for part in whole])
    return LayerPixels(sources, targets, ends, np.array([len(part[0]) for part in parts]), made)
