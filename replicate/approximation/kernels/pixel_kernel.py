"""Vector kernels that make up the convolutions and their gradients: 16 channels are one vector, in LLVM's own words.

Plain loops leave it to the compiler to keep the sums in registers, and it does not. Here eight sums of 16 channels each
stay there while all taps of a kernel go by. Pixels need not be neighbours, so that a layer can leave out those that
nothing reads (`pixel_lists`). Each has a twin in NumPy, `…_reference`.
"""

from collections.abc import Callable

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.errors import TypingError
from numba.core.typing.templates import Signature
from numba.extending import intrinsic

from replicate.approximation.kernels.vector_code import CHANNELS, INDEX, VECTOR, data, number_at, splat, vector

TILE = 8  # pixels at a time
STEP = 4  # channels at a time


def multiply_pixels_reference(
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
        for offset, weight in zip(offsets, weights, strict=True):
            at = sources[k] + offset
            total += image[at : at + channels] @ weight
        out[targets[k] : targets[k] + CHANNELS] = np.maximum(total, np.float32(slope) * total)


def add_pixels_reference(
    out: np.ndarray, targets: np.ndarray, shift: int, image: np.ndarray, sources: np.ndarray, first: int,
    tap: np.ndarray,
) -> None:  # fmt: skip
    """Add image[source] @ tap to out[target + shift] for the pixels first … first + 7 of a list.

    A pixel that the tile has several times is added once. tap: (16, 16), flat. Other arguments as above.
    """
    for k in dict(zip(targets[first : first + TILE], range(first, first + TILE), strict=True)).values():
        at = targets[k] + shift
        out[at : at + CHANNELS] += image[sources[k] : sources[k] + CHANNELS] @ tap.reshape(CHANNELS, CHANNELS)


def correlate_pixels_reference(
    gradient: np.ndarray, image: np.ndarray, sources: np.ndarray, offset: int, upstream: np.ndarray,
    targets: np.ndarray, first: int, last: int,
) -> None:  # fmt: skip
    """Add Σ image[source + offset]ᵀ upstream[target] over the pixels first … last − 1 of a list to gradient (16, 16).

    image, upstream: flat. sources, targets: int32, where each pixel lies in either.
    """
    for k in range(first, last):
        a, b = sources[k] + offset, targets[k]
        gradient += np.outer(image[a : a + CHANNELS], upstream[b : b + CHANNELS])


def deactivate_pixels_reference(
    upstream: np.ndarray, image: np.ndarray, made: np.ndarray, slope: float, sums: np.ndarray
) -> None:
    """Take a gradient through the leaky ReLU that gave `image`, in place, and add it to sums (16,), pixel by pixel.

    made: int32, where pixels lie. Other pixels stay as they are.
    """
    for place in made:
        own = slice(place, place + CHANNELS)
        upstream[own] *= np.where(image[own] > 0, 1, np.float32(slope))
        sums += upstream[own]


def read_back_reference(
    image: np.ndarray, upper: np.ndarray, below: int, shares: np.ndarray, weight: np.ndarray, upstream: np.ndarray,
    out: np.ndarray, gradient: np.ndarray,
) -> None:  # fmt: skip
    """Add to `out`, and to the gradient in a 1×1 convolution, what `upstream` gives them: vertices read an image by it.

    image, out: flat. upper: int32, where the first of a vertex's four pixels lies; the second is right of it, the
    others `below`. shares: (k, 4). weight, gradient: (3, 16). upstream: (k, 3).
    """
    for i, at in enumerate(upper):
        corners = [slice(at + step, at + step + CHANNELS) for step in (0, CHANNELS, below, below + CHANNELS)]
        sample = sum(image[corner] * share for corner, share in zip(corners, shares[i], strict=True))
        gradient += np.outer(upstream[i], sample)
        for corner, share in zip(corners, shares[i], strict=True):
            out[corner] += share * (upstream[i] @ weight)


def _place(builder, array, index):
    """Return a number of an int32 array, as an index."""
    return builder.sext(builder.load(number_at(builder, array, index)), INDEX)


def _call(builder, name, *args):
    function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(VECTOR, [VECTOR] * len(args)), name)
    return builder.call(function, args)


@intrinsic
def multiply_pixels(
    typing: object, out: types.Type, targets: types.Type, image: types.Type, sources: types.Type, first: types.Type,
    offsets: types.Type, taps: types.Type, channels: types.Type, bias: types.Type, slope: types.Type,
) -> tuple[Signature, Callable]:  # fmt: skip
    """Compile `multiply_pixels_reference`; channels is a multiple of STEP."""
    if {targets.dtype, sources.dtype, offsets.dtype} != {types.int32}:
        raise TypingError("places of pixels are int32")

    def generate(context, builder, signature, args):
        kinds = signature.args
        out, targets, image, sources, offsets, taps, bias = (
            data(context, builder, kinds[k], args[k]) for k in (0, 1, 2, 3, 5, 6, 8)
        )
        first, channels, slope = args[4], args[7], args[9]
        count = builder.extract_value(context.make_array(kinds[5])(context, builder, args[5]).shape, 0)
        places = [builder.add(first, ir.Constant(INDEX, k)) for k in range(TILE)]
        pixels = [number_at(builder, image, _place(builder, sources, place)) for place in places]
        sums = [cgutils.alloca_once(builder, VECTOR) for _ in range(TILE)]
        start = builder.load(vector(builder, bias), align=4)
        for total in sums:
            builder.store(start, total)
        block = builder.mul(channels, ir.Constant(INDEX, CHANNELS))
        steps = builder.udiv(channels, ir.Constant(INDEX, STEP))
        with cgutils.for_range(builder, count, intp=INDEX) as tap:
            offset = _place(builder, offsets, tap.index)
            tap_first = builder.mul(tap.index, block)
            with cgutils.for_range(builder, steps, intp=INDEX) as step:
                for k in range(STEP):
                    channel = builder.add(builder.mul(step.index, ir.Constant(INDEX, STEP)), ir.Constant(INDEX, k))
                    row = builder.add(tap_first, builder.mul(channel, ir.Constant(INDEX, CHANNELS)))
                    weight = builder.load(vector(builder, number_at(builder, taps, row)), align=4)
                    at = builder.add(offset, channel)
                    for pixel, total in zip(pixels, sums, strict=True):
                        value = splat(builder, builder.load(number_at(builder, pixel, at)))
                        builder.store(_call(builder, "llvm.fma.v16f32", value, weight, builder.load(total)), total)
        fall = splat(builder, slope)
        for place, total in zip(places, sums, strict=True):
            value = builder.load(total)
            value = _call(builder, "llvm.maxnum.v16f32", value, builder.fmul(value, fall))
            target = number_at(builder, out, _place(builder, targets, place))
            builder.store(value, vector(builder, target), align=4)
        return context.get_dummy_value()

    index = types.int64
    signature = types.void(out, targets, image, sources, index, offsets, taps, index, bias, types.float32)
    return signature, generate


@intrinsic
def add_pixels(
    typing: object, out: types.Type, targets: types.Type, shift: types.Type, image: types.Type, sources: types.Type,
    first: types.Type, tap: types.Type,
) -> tuple[Signature, Callable]:  # fmt: skip
    """Compile `add_pixels_reference`: all pixels of the tile are read before one is written."""
    if {targets.dtype, sources.dtype} != {types.int32}:
        raise TypingError("places of pixels are int32")

    def generate(context, builder, signature, args):
        kinds = signature.args
        out, targets, image, sources, tap = (data(context, builder, kinds[k], args[k]) for k in (0, 1, 3, 4, 6))
        shift, first = args[2], args[5]
        listed = [builder.add(first, ir.Constant(INDEX, k)) for k in range(TILE)]
        pixels = [number_at(builder, image, _place(builder, sources, place)) for place in listed]
        goals = [
            vector(builder, number_at(builder, out, builder.add(_place(builder, targets, place), shift)))
            for place in listed
        ]
        sums = [cgutils.alloca_once(builder, VECTOR) for _ in range(TILE)]
        for goal, total in zip(goals, sums, strict=True):
            builder.store(builder.load(goal, align=4), total)
        with cgutils.for_range(builder, ir.Constant(INDEX, CHANNELS // STEP), intp=INDEX) as step:
            for k in range(STEP):
                channel = builder.add(builder.mul(step.index, ir.Constant(INDEX, STEP)), ir.Constant(INDEX, k))
                row = builder.mul(channel, ir.Constant(INDEX, CHANNELS))
                weight = builder.load(vector(builder, number_at(builder, tap, row)), align=4)
                for pixel, total in zip(pixels, sums, strict=True):
                    value = splat(builder, builder.load(number_at(builder, pixel, channel)))
                    builder.store(_call(builder, "llvm.fma.v16f32", value, weight, builder.load(total)), total)
        for goal, total in zip(goals, sums, strict=True):
            builder.store(builder.load(total), goal, align=4)
        return context.get_dummy_value()

    index = types.int64
    return types.void(out, targets, index, image, sources, index, tap), generate


@intrinsic
def correlate_pixels(
    typing: object, gradient: types.Type, image: types.Type, sources: types.Type, offset: types.Type,
    upstream: types.Type, targets: types.Type, first: types.Type, last: types.Type,
) -> tuple[Signature, Callable]:  # fmt: skip
    """Compile `correlate_pixels_reference`."""
    if {targets.dtype, sources.dtype} != {types.int32}:
        raise TypingError("places of pixels are int32")

    def generate(context, builder, signature, args):
        kinds = signature.args
        gradient, image, sources, upstream, targets = (
            data(context, builder, kinds[k], args[k]) for k in (0, 1, 2, 4, 5)
        )
        offset, first, last = args[3], args[6], args[7]
        for half in (0, CHANNELS // 2):
            sums = [cgutils.alloca_once(builder, VECTOR) for _ in range(CHANNELS // 2)]
            places = [
                vector(builder, number_at(builder, gradient, ir.Constant(INDEX, (half + k) * CHANNELS)))
                for k in range(CHANNELS // 2)
            ]
            for place, total in zip(places, sums, strict=True):
                builder.store(builder.load(place, align=4), total)
            with cgutils.for_range_slice(builder, first, last, ir.Constant(INDEX, 1), intp=INDEX, inc=True) as (k, _):
                a, b = builder.add(_place(builder, sources, k), offset), _place(builder, targets, k)
                right = builder.load(vector(builder, number_at(builder, upstream, b)), align=4)
                pixel = number_at(builder, image, a)
                for channel, total in enumerate(sums):
                    left = builder.load(number_at(builder, pixel, ir.Constant(INDEX, half + channel)))
                    product = _call(builder, "llvm.fma.v16f32", splat(builder, left), right, builder.load(total))
                    builder.store(product, total)
            for place, total in zip(places, sums, strict=True):
                builder.store(builder.load(total), place, align=4)
        return context.get_dummy_value()

    index = types.int64
    signature = types.void(gradient, image, sources, index, upstream, targets, index, index)
    return signature, generate


@intrinsic
def deactivate_pixels(
    typing: object, upstream: types.Type, image: types.Type, made: types.Type, slope: types.Type, sums: types.Type
) -> tuple[Signature, Callable]:
    """Compile `deactivate_pixels_reference`."""
    if made.dtype != types.int32:
        raise TypingError("places of pixels are int32")

    def generate(context, builder, signature, args):
        kinds = signature.args
        upstream, image, made, sums = (data(context, builder, kinds[k], args[k]) for k in (0, 1, 2, 4))
        count = builder.extract_value(context.make_array(kinds[2])(context, builder, args[2]).shape, 0)
        fall, nothing = splat(builder, args[3]), ir.Constant(VECTOR, [0.0] * CHANNELS)
        total = cgutils.alloca_once(builder, VECTOR)
        builder.store(builder.load(vector(builder, sums), align=4), total)
        with cgutils.for_range(builder, count, intp=INDEX) as pixel:
            at = _place(builder, made, pixel.index)
            goal = vector(builder, number_at(builder, upstream, at))
            made_of = builder.load(vector(builder, number_at(builder, image, at)), align=4)
            value = builder.load(goal, align=4)
            value = builder.select(builder.fcmp_ordered(">", made_of, nothing), value, builder.fmul(value, fall))
            builder.store(value, goal, align=4)
            builder.store(builder.fadd(builder.load(total), value), total)
        builder.store(builder.load(total), vector(builder, sums), align=4)
        return context.get_dummy_value()

    return types.void(upstream, image, made, types.float32, sums), generate


@intrinsic
def read_back(
    typing: object, image: types.Type, upper: types.Type, below: types.Type, shares: types.Type, weight: types.Type,
    upstream: types.Type, out: types.Type, gradient: types.Type,
) -> tuple[Signature, Callable]:  # fmt: skip
    """Compile `read_back_reference`."""
    if upper.dtype != types.int32:
        raise TypingError("places of pixels are int32")

    def generate(context, builder, signature, args):
        kinds, below = signature.args, args[2]
        image, upper, shares, weight, upstream, out, gradient = (
            data(context, builder, kinds[k], args[k]) for k in (0, 1, 3, 4, 5, 6, 7)
        )
        count = builder.extract_value(context.make_array(kinds[1])(context, builder, args[1]).shape, 0)

        def row(array, index):
            return vector(builder, number_at(builder, array, ir.Constant(INDEX, index * CHANNELS)))

        def numbers(array, index, width):
            first = builder.mul(index, ir.Constant(INDEX, width))
            each = (builder.add(first, ir.Constant(INDEX, k)) for k in range(width))
            return [splat(builder, builder.load(number_at(builder, array, place))) for place in each]

        weights = [builder.load(row(weight, k), align=4) for k in range(3)]
        totals = [cgutils.alloca_once(builder, VECTOR) for _ in range(3)]
        for k, total in enumerate(totals):
            builder.store(builder.load(row(gradient, k), align=4), total)
        with cgutils.for_range(builder, count, intp=INDEX) as vertex:
            at = _place(builder, upper, vertex.index)
            under = builder.add(at, below)
            right = ir.Constant(INDEX, CHANNELS)
            corners = [at, builder.add(at, right), under, builder.add(under, right)]
            pixels = [builder.load(vector(builder, number_at(builder, image, place)), align=4) for place in corners]
            parts, pulls = numbers(shares, vertex.index, 4), numbers(upstream, vertex.index, 3)
            sample = builder.fmul(pixels[0], parts[0])
            for pixel, part in zip(pixels[1:], parts[1:], strict=True):
                sample = _call(builder, "llvm.fma.v16f32", pixel, part, sample)
            for pull, total in zip(pulls, totals, strict=True):
                builder.store(_call(builder, "llvm.fma.v16f32", sample, pull, builder.load(total)), total)
            pulled = builder.fmul(weights[0], pulls[0])
            for own, pull in zip(weights[1:], pulls[1:], strict=True):
                pulled = _call(builder, "llvm.fma.v16f32", own, pull, pulled)
            for place, part in zip(corners, parts, strict=True):
                goal = vector(builder, number_at(builder, out, place))
                builder.store(
                    _call(builder, "llvm.fma.v16f32", pulled, part, builder.load(goal, align=4)), goal, align=4
                )
        for k, total in enumerate(totals):
            builder.store(builder.load(total), row(gradient, k), align=4)
        return context.get_dummy_value()

    return types.void(image, upper, types.int64, shares, weight, upstream, out, gradient), generate
