"""Products of a few rows with large matrices of 32-bit, 16-bit and 8-bit numbers, and the buffers that they work in."""

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple, no_type_check

import llvmlite.binding
import numpy as np
from jaxtyping import Float, Int8
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.errors import TypingError
from numba.core.typing.templates import Signature

from replicate.base.jit_cache import kept
from replicate.kernels.map_kernel import REORDER
from replicate.kernels.vector_code import INDEX, PLAIN, data, twin_of

ROWS = 8  # at a time, so that sums are loaded and stored less often
COLUMNS = 4_096  # at a time, so that sums stay in the nearest cache
NOTHING = np.int64(0)  # the start of a count: for the literal 0 functions would be compiled once more


def has_halves() -> bool:
    """Return whether this processor reads float16; the plain twins don't."""
    if PLAIN:
        return False
    features = llvmlite.binding.get_host_cpu_features()
    return bool(features.get("f16c", "x86" not in llvmlite.binding.get_process_triple()))


def without_loss(weights: Float[np.ndarray, "..."], halves: bool | None = None) -> np.ndarray:
    """Return weights as the products read them: the bits of float16 where that loses nothing, else float32.

    halves: True for float16 even where it rounds, if all weights are in its range. On a processor that can't read
    float16 they stay float32.
    """
    exact = np.asarray(weights, np.float32)
    with np.errstate(over="ignore"):
        short = exact.astype(np.float16)
    fits = np.isfinite(short).all() if halves else (short == exact).all()
    return short.view(np.uint16) if has_halves() and fits else exact


@no_type_check
def as_float32_plain(value: float) -> np.float32:
    """Return a stored number as float32."""
    return np.float32(value)


@twin_of(as_float32_plain)
def as_float32(typing: object, value: types.Type) -> tuple[Signature, Callable]:
    """Return a stored number as float32; uint16 holds the bits of a float16."""
    if value not in (types.float32, types.uint16, types.int16, types.int8):
        raise TypingError(f"weights: expected float32, uint16 (bits of float16), int16 or int8, got {value}")

    def generate(context, builder, signature, args):
        if value == types.float32:
            return args[0]
        if value == types.uint16:
            return builder.fpext(builder.bitcast(args[0], ir.HalfType()), ir.FloatType())
        return builder.sitofp(args[0], ir.FloatType())

    return types.float32(value), generate


@kept
@njit(error_model="numpy", fastmath=REORDER, nogil=True)
@no_type_check
def add_products(x: np.ndarray, weights: np.ndarray, first: int, width: int, out: np.ndarray, rows: np.ndarray) -> None:
    """Add x @ w to `out`, for a matrix w that lies row by row in a flat array; rows for zeros in x are not read.

    x: (k,).
    weights: flat, of any of the kinds that `as_float32` takes.
    first: where the matrix begins in `weights`.
    width: columns of the matrix.
    out: (width,) float32.
    rows: scratch for k indices.
    """
    count = 0
    for i in range(len(x)):
        if x[i] != 0:
            rows[count] = i
            count += 1
    whole = count // ROWS * ROWS
    for column in range(0, width, COLUMNS):
        size = min(COLUMNS, width - column)
        sums = out[column : column + size]
        start = first + column
        for n in range(0, whole, ROWS):
            i, j, k, l = rows[n], rows[n + 1], rows[n + 2], rows[n + 3]  # noqa: E741
            p, q, r, s = rows[n + 4], rows[n + 5], rows[n + 6], rows[n + 7]
            xi, xj, xk, xl, xp, xq, xr, xs = x[i], x[j], x[k], x[l], x[p], x[q], x[r], x[s]
            wi, wj = _row(weights, start, i, width, size), _row(weights, start, j, width, size)
            wk, wl = _row(weights, start, k, width, size), _row(weights, start, l, width, size)
            wp, wq = _row(weights, start, p, width, size), _row(weights, start, q, width, size)
            wr, ws = _row(weights, start, r, width, size), _row(weights, start, s, width, size)
            for c in range(size):
                near = xi * as_float32(wi[c]) + xj * as_float32(wj[c]) + xk * as_float32(wk[c])
                far = xp * as_float32(wp[c]) + xq * as_float32(wq[c]) + xr * as_float32(wr[c])
                sums[c] += (near + xl * as_float32(wl[c])) + (far + xs * as_float32(ws[c]))
        for n in range(whole, count):
            xi, wi = x[rows[n]], _row(weights, start, rows[n], width, size)
            for c in range(size):
                sums[c] += xi * as_float32(wi[c])


@njit(inline="always")
@no_type_check
def _row(weights, start, row, width, size):
    return weights[start + row * width : start + row * width + size]


# Products of a vector with a matrix of 8-bit whole numbers, two rows at a time.

BLOCK = 64  # columns at a time, whose sums stay in registers
LARGEST = 32_767  # of 16 bits
ROOM = (2**31 - 1) // 128  # what 32 bits hold of products with 8 bits
LANES = 8  # sums of a register
PAIR, SUMS = ir.VectorType(ir.IntType(16), 2 * LANES), ir.VectorType(ir.IntType(32), LANES)
X86 = "llvm.x86.avx2.pmadd.wd"


def has_pair_instruction() -> bool:
    """Return whether this processor has an instruction that multiplies and adds pairs, and LLVM a name for it."""
    return bool(llvmlite.binding.get_host_cpu_features().get("avx2"))


def in_pairs(rows: Int8[np.ndarray, "k w"]) -> np.ndarray:
    """Return a matrix's numbers as `add_pairs` reads them: flat, [block of columns, pair of rows, column, row].

    Zeros fill the last block, and the last pair of an odd number of rows.
    """
    count, width = rows.shape
    full = np.zeros((count + count % 2, padded(width)), np.int8)
    full[:count, :width] = rows
    return full.reshape(len(full) // 2, 2, padded(width) // BLOCK, BLOCK).transpose(2, 0, 3, 1).ravel()


@kept
@njit(inline="always")
@no_type_check
def padded(width: int) -> int:
    """Return a number of columns, filled up to whole blocks."""
    return (width + BLOCK - 1) // BLOCK * BLOCK


@no_type_check
def sum_block_plain(weights: np.ndarray, first: int, pairs: np.ndarray, count: int, sums: np.ndarray) -> None:
    """Write the sums of one block's products over `count` pairs of rows.

    weights: int8, as `in_pairs` stores them. first: where the block begins in them. pairs: int32, each of two 16-bit
    factors, the first in the lower half. sums: (BLOCK,) int32.
    """
    sums[:] = 0
    for k in range(count):
        low, high = np.int32(np.int16(pairs[k] & 0xFFFF)), pairs[k] >> 16
        for c in range(BLOCK):
            at = first + 2 * (k * BLOCK + c)
            sums[c] += low * weights[at] + high * weights[at + 1]


@twin_of(sum_block_plain)
def _sum_block(
    typing: object, weights: types.Array, first: types.Integer, pairs: types.Array, count: types.Integer,
    sums: types.Array,
) -> tuple[Signature, Callable]:  # fmt: skip
    """Compile `sum_block_plain`."""
    kinds = weights.dtype, pairs.dtype, sums.dtype
    if kinds != (types.int8, types.int32, types.int32):
        raise TypingError(f"weights, pairs and sums: expected int8, int32 and int32, got {kinds}")

    def generate(context, builder, signature, args):
        kinds = signature.args
        numbers = builder.gep(data(context, builder, kinds[0], args[0]), [args[1]])
        two, out = data(context, builder, kinds[2], args[2]), data(context, builder, kinds[4], args[4])
        totals = [cgutils.alloca_once_value(builder, ir.Constant(SUMS, None)) for _ in range(BLOCK // LANES)]
        with cgutils.for_range(builder, args[3], intp=INDEX) as loop:
            both = builder.load(builder.gep(two, [loop.index]))
            in_first = builder.insert_element(ir.Constant(SUMS, ir.Undefined), both, ir.Constant(ir.IntType(32), 0))
            zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
            factors = builder.bitcast(builder.shuffle_vector(in_first, ir.Constant(SUMS, ir.Undefined), zeros), PAIR)
            row = builder.gep(numbers, [builder.mul(loop.index, ir.Constant(INDEX, 2 * BLOCK))])
            for k, total in enumerate(totals):
                place = builder.gep(row, [ir.Constant(INDEX, 2 * LANES * k)])
                stored = ir.VectorType(ir.IntType(8), 2 * LANES).as_pointer()
                read = builder.sext(builder.load(builder.bitcast(place, stored), align=1), PAIR)
                builder.store(builder.add(builder.load(total), _add_pairs(builder, read, factors)), total)
        for k, total in enumerate(totals):
            place = builder.gep(out, [ir.Constant(INDEX, LANES * k)])
            builder.store(builder.load(total), builder.bitcast(place, SUMS.as_pointer()), align=4)
        return context.get_dummy_value()

    return types.void(weights, types.int64, pairs, types.int64, sums), generate


def _add_pairs(builder: ir.IRBuilder, left: ir.Value, right: ir.Value) -> ir.Value:
    """Return the 32-bit sum of both products of each pair of 16-bit numbers."""
    if has_pair_instruction():
        kind = ir.FunctionType(SUMS, [PAIR, PAIR])
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, X86), (left, right))
    products = []
    for first in range(2):
        places = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [2 * k + first for k in range(LANES)])
        halves = (builder.shuffle_vector(each, ir.Constant(PAIR, ir.Undefined), places) for each in (left, right))
        products.append(builder.mul(*(builder.sext(half, SUMS) for half in halves)))
    return builder.add(*products)


@kept
@njit(error_model="numpy", nogil=True)
@no_type_check
def add_pairs(x: np.ndarray, weights: np.ndarray, first: int, width: int, out: np.ndarray, pairs: np.ndarray) -> int:
    """Add x @ w to `out`, for a matrix w that `in_pairs` has stored; return where it ends in `weights`.

    Where a number in x isn't finite, all of `out` becomes NaN.

    x: (k,).
    weights: flat, int8.
    first: where the matrix begins in `weights`.
    width: columns of the matrix.
    out: (width,) float32.
    pairs: int32 scratch for BLOCK numbers and one for each pair in x.
    """
    count = (len(x) + 1) // 2
    end = first + 2 * count * padded(width)
    largest, lost = np.float32(0), np.float32(0)
    for k in range(len(x)):
        largest = max(largest, abs(x[k]))
        lost += x[k] * np.float32(0)
    if lost != 0:  # not a number
        out[:width] = lost
        return end
    if largest == 0:
        return end
    sums, both = pairs[:BLOCK], pairs[BLOCK : BLOCK + count]
    whole = np.float32(min(LARGEST, ROOM // len(x)))  # what the largest becomes: no sum can overflow
    times, unit = whole / largest, largest / whole
    for k in range(count):
        low = np.int32(np.rint(x[2 * k] * times))
        high = np.int32(np.rint(x[2 * k + 1] * times)) if 2 * k + 1 < len(x) else np.int32(0)
        both[k] = (low & np.int32(0xFFFF)) | (high << np.int32(16))
    for column in range(NOTHING, width, BLOCK):
        _sum_block(weights, first + 2 * count * column, both, count, sums)
        for c in range(min(BLOCK, width - column)):
            out[column + c] += unit * np.float32(sums[c])
    return end


# What one pose costs the fast evaluation: multiplications that are really done, and bytes of weights that are read.


class Work(NamedTuple):
    """The work of a pose.

    multiplications: products of a weight or a share with what it weighs. read_bytes: of weights, bases and lists of
    pixels, each of which counts once, though small ones are read again from the nearest cache.
    """

    multiplications: int
    read_bytes: int


def total(parts: Iterable[Work]) -> Work:
    """Return the sum of some work."""
    parts = list(parts)
    return Work(sum(part.multiplications for part in parts), sum(part.read_bytes for part in parts))


def of_layers(inputs: np.ndarray, widths: Sequence[int], itemsize: int) -> Work:
    """Return the work of dense layers in a row, which leave out the weights of inputs that are zero.

    inputs: of the first layer; those of the others are never zero. widths: of the layers' outputs. itemsize: bytes of
    a weight.
    """
    rows = [int(np.count_nonzero(inputs)), *widths[:-1]]
    products = sum(int(row) * int(width) for row, width in zip(rows, widths, strict=True))
    return Work(products, products * itemsize)
