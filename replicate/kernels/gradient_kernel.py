"""Vector kernels of what else gradients go through: leaky ReLUs, and the vertices that read the last map.

Sums stay in registers while all pixels or vertices go by. Each has a plain twin, `…_plain`.
"""

from collections.abc import Callable
from typing import no_type_check

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import Signature

from replicate.kernels.vector_code import (  # fmt: skip
    CHANNELS,
    INDEX,
    VECTOR,
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


@no_type_check
def deactivate_pixels_plain(
    upstream: np.ndarray, image: np.ndarray, made: np.ndarray, slope: float, sums: np.ndarray
) -> None:
    """Take a gradient through the leaky ReLU that gave `image`, in place, and add it to sums (16,), pixel by pixel.

    made: int32, where pixels lie. Other pixels stay as they are.
    """
    for place in made:
        for c in range(CHANNELS):
            if not image[place + c] > 0:
                upstream[place + c] *= np.float32(slope)
            sums[c] += upstream[place + c]


@no_type_check
def read_back_plain(
    image: np.ndarray, upper: np.ndarray, below: int, shares: np.ndarray, weight: np.ndarray, upstream: np.ndarray,
    out: np.ndarray, gradient: np.ndarray,
) -> None:  # fmt: skip
    """Add to `out`, and to the gradient in a 1×1 convolution, what `upstream` gives them: vertices read an image by it.

    image, out: flat. upper: int32, where the first of a vertex's four pixels lies; the second is right of it, the
    others `below`. shares: (k, 4). weight, gradient: (3, 16). upstream: (k, 3).
    """
    for i in range(len(upper)):
        for corner in range(4):
            at = upper[i] + (corner % 2) * CHANNELS + (corner // 2) * below
            for k in range(3):
                gradient[k] += upstream[i, k] * shares[i, corner] * image[at : at + CHANNELS]
                out[at : at + CHANNELS] += shares[i, corner] * upstream[i, k] * weight[k]


@twin_of(deactivate_pixels_plain)
def deactivate_pixels(
    typing: object, upstream: types.Type, image: types.Type, made: types.Type, slope: types.Type, sums: types.Type
) -> tuple[Signature, Callable]:
    """Compile `deactivate_pixels_plain`."""
    check_places(made)

    def generate(context, builder, signature, args):
        kinds = signature.args
        upstream, image, made, sums = (data(context, builder, kinds[k], args[k]) for k in (0, 1, 2, 4))
        fall, nothing = splat(builder, args[3]), ir.Constant(VECTOR, [0.0] * CHANNELS)
        (total,) = variables(builder, 1)
        builder.store(load(builder, sums), total)
        with cgutils.for_range(builder, length(context, builder, kinds[2], args[2]), intp=INDEX) as pixel:
            at = place_in(builder, made, pixel.index)
            goal = number_at(builder, upstream, at)
            passes = builder.fcmp_ordered(">", load(builder, number_at(builder, image, at)), nothing)
            value = load(builder, goal)
            value = builder.select(passes, value, builder.fmul(value, fall))
            store(builder, value, goal)
            builder.store(builder.fadd(builder.load(total), value), total)
        store(builder, builder.load(total), sums)
        return context.get_dummy_value()

    return types.void(upstream, image, made, types.float32, sums), generate


@twin_of(read_back_plain)
def read_back(
    typing: object, image: types.Type, upper: types.Type, below: types.Type, shares: types.Type, weight: types.Type,
    upstream: types.Type, out: types.Type, gradient: types.Type,
) -> tuple[Signature, Callable]:  # fmt: skip
    """Compile `read_back_plain`."""
    check_places(upper)

    def generate(context, builder, signature, args):
        kinds, below, right = signature.args, args[2], ir.Constant(INDEX, CHANNELS)
        image, upper, shares, weight, upstream, out, gradient = (
            data(context, builder, kinds[k], args[k]) for k in (0, 1, 3, 4, 5, 6, 7)
        )

        def numbers(array, index, width):
            first = builder.mul(index, ir.Constant(INDEX, width))
            each = (builder.add(first, ir.Constant(INDEX, k)) for k in range(width))
            return [splat(builder, builder.load(number_at(builder, array, place))) for place in each]

        rows = [ir.Constant(INDEX, k * CHANNELS) for k in range(3)]
        weights = [load(builder, number_at(builder, weight, row)) for row in rows]
        totals = variables(builder, 3)
        for row, total in zip(rows, totals, strict=True):
            builder.store(load(builder, number_at(builder, gradient, row)), total)
        with cgutils.for_range(builder, length(context, builder, kinds[1], args[1]), intp=INDEX) as vertex:
            at = place_in(builder, upper, vertex.index)
            under = builder.add(at, below)
            corners = [at, builder.add(at, right), under, builder.add(under, right)]
            pixels = [load(builder, number_at(builder, image, corner)) for corner in corners]
            parts, pulls = numbers(shares, vertex.index, 4), numbers(upstream, vertex.index, 3)
            sample, pulled = builder.fmul(pixels[0], parts[0]), builder.fmul(weights[0], pulls[0])
            for pixel, part in zip(pixels[1:], parts[1:], strict=True):
                sample = call(builder, "fma", pixel, part, sample)
            for row, pull in zip(weights[1:], pulls[1:], strict=True):
                pulled = call(builder, "fma", row, pull, pulled)
            for pull, total in zip(pulls, totals, strict=True):
                add_product(builder, total, sample, pull)
            for corner, part in zip(corners, parts, strict=True):
                goal = number_at(builder, out, corner)
                store(builder, call(builder, "fma", pulled, part, load(builder, goal)), goal)
        for row, total in zip(rows, totals, strict=True):
            store(builder, builder.load(total), number_at(builder, gradient, row))
        return context.get_dummy_value()

    return types.void(image, upper, types.int64, shares, weight, upstream, out, gradient), generate
