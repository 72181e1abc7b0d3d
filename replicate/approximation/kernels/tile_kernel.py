"""Two vector kernels that make up the convolutions: 16 channels are one vector, written for LLVM directly.

Plain loops leave it to the compiler to keep the sums in registers, and it does not. Here eight sums of 16 channels
each stay there while all taps of a kernel go by. Images are flat float32 arrays with 16 channels last; "first" and
"step" are positions in numbers, not pixels. `multiply_reference` and `correlate_reference` say the same in NumPy.
"""

from collections.abc import Callable

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import Signature
from numba.extending import intrinsic

from replicate.approximation.kernels.vector_code import CHANNELS, INDEX, VECTOR, data, number_at, splat, vector

TILE = 8  # pixels at a time


def multiply_reference(
    y: np.ndarray, y_first: int, y_step: int, x: np.ndarray, x_first: int, x_step: int,
    offsets: np.ndarray, weights: np.ndarray, start: np.ndarray,
) -> None:  # fmt: skip
    """Write start + Σ_t x[pixel + offsets[t]] @ weights[t] to a tile of pixels.

    The i-th pixel of the tile is read at x_first + i·x_step and written at y_first + i·y_step. offsets: (t,) int64.
    weights: (t, 16, 16), [tap, channel in, channel out]. start: (16,), the bias.
    """
    for i in range(TILE):
        total = start.copy()
        for offset, weight in zip(offsets, weights, strict=True):
            at = x_first + i * x_step + offset
            total += x[at : at + CHANNELS] @ weight
        at = y_first + i * y_step
        y[at : at + CHANNELS] = total


def correlate_reference(
    gradient: np.ndarray, x: np.ndarray, x_first: int, x_step: int, x_row: int,
    y: np.ndarray, y_first: int, y_step: int, y_row: int, columns: int, rows: int,
) -> None:  # fmt: skip
    """Add Σ x[pixel]ᵀ y[pixel] over rows × columns of pixels to gradient (16, 16), [channel of x, channel of y]."""
    for row in range(rows):
        for column in range(columns):
            a, b = x_first + row * x_row + column * x_step, y_first + row * y_row + column * y_step
            gradient += np.outer(x[a : a + CHANNELS], y[b : b + CHANNELS])


def _add_product(builder, total, left, right):
    kind = ir.FunctionType(VECTOR, [VECTOR] * 3)
    fma = cgutils.get_or_insert_function(builder.module, kind, f"llvm.fma.v{CHANNELS}f32")
    builder.store(builder.call(fma, [left, right, builder.load(total)]), total)


def _sums(builder, count):
    return [cgutils.alloca_once(builder, VECTOR) for _ in range(count)]


@intrinsic
def multiply(
    typing: object, y: types.Type, y_first: types.Type, y_step: types.Type, x: types.Type, x_first: types.Type,
    x_step: types.Type, offsets: types.Type, weights: types.Type, start: types.Type,
) -> tuple[Signature, Callable]:  # fmt: skip
    """Compile `multiply_reference`."""

    def generate(context, builder, signature, args):
        kinds = signature.args
        y, x, offsets, weights, start = (data(context, builder, kinds[k], args[k]) for k in (0, 3, 6, 7, 8))
        y_first, y_step, x_first, x_step = (args[k] for k in (1, 2, 4, 5))
        taps = builder.extract_value(context.make_array(kinds[6])(context, builder, args[6]).shape, 0)
        sums = _sums(builder, TILE)
        initial = builder.load(vector(builder, start), align=4)
        for total in sums:
            builder.store(initial, total)
        with cgutils.for_range(builder, taps, intp=INDEX) as tap:
            at = builder.add(x_first, builder.load(number_at(builder, offsets, tap.index)))
            pixels = []
            for _ in range(TILE):
                pixels.append(number_at(builder, x, at))
                at = builder.add(at, x_step)
            block = builder.mul(tap.index, ir.Constant(INDEX, CHANNELS**2))
            with cgutils.for_range(builder, ir.Constant(INDEX, CHANNELS // 4), intp=INDEX) as quarter:
                for k in range(4):
                    channel = builder.add(builder.mul(quarter.index, ir.Constant(INDEX, 4)), ir.Constant(INDEX, k))
                    row = builder.add(block, builder.mul(channel, ir.Constant(INDEX, CHANNELS)))
                    weight = builder.load(vector(builder, number_at(builder, weights, row)), align=4)
                    for pixel, total in zip(pixels, sums, strict=True):
                        value = splat(builder, builder.load(number_at(builder, pixel, channel)))
                        _add_product(builder, total, value, weight)
        at = y_first
        for total in sums:
            builder.store(builder.load(total), vector(builder, number_at(builder, y, at)), align=4)
            at = builder.add(at, y_step)
        return context.get_dummy_value()

    index = types.int64
    return types.void(y, index, index, x, index, index, offsets, weights, start), generate


@intrinsic
def correlate(
    typing: object, gradient: types.Type, x: types.Type, x_first: types.Type, x_step: types.Type, x_row: types.Type,
    y: types.Type, y_first: types.Type, y_step: types.Type, y_row: types.Type, columns: types.Type, rows: types.Type,
) -> tuple[Signature, Callable]:  # fmt: skip
    """Compile `correlate_reference`."""

    def generate(context, builder, signature, args):
        kinds = signature.args
        gradient, x, y = (data(context, builder, kinds[k], args[k]) for k in (0, 1, 5))
        x_first, x_step, x_row, y_first, y_step, y_row, columns, rows = (args[k] for k in (2, 3, 4, 6, 7, 8, 9, 10))
        for half in (0, CHANNELS // 2):
            sums = _sums(builder, CHANNELS // 2)
            places = [
                vector(builder, number_at(builder, gradient, ir.Constant(INDEX, (half + k) * CHANNELS)))
                for k in range(CHANNELS // 2)
            ]
            for place, total in zip(places, sums, strict=True):
                builder.store(builder.load(place, align=4), total)
            with cgutils.for_range(builder, rows, intp=INDEX) as row:
                a0 = builder.add(x_first, builder.mul(row.index, x_row))
                b0 = builder.add(y_first, builder.mul(row.index, y_row))
                with cgutils.for_range(builder, columns, intp=INDEX) as column:
                    a = number_at(builder, x, builder.add(a0, builder.mul(column.index, x_step)))
                    b = number_at(builder, y, builder.add(b0, builder.mul(column.index, y_step)))
                    right = builder.load(vector(builder, b), align=4)
                    for k, total in enumerate(sums):
                        left = splat(builder, builder.load(number_at(builder, a, ir.Constant(INDEX, half + k))))
                        _add_product(builder, total, left, right)
            for place, total in zip(places, sums, strict=True):
                builder.store(builder.load(total), place, align=4)
        return context.get_dummy_value()

    index = types.int64
    return types.void(gradient, x, index, index, index, y, index, index, index, index, index), generate
