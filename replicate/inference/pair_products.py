"""Products of a vector with the rows of a matrix of whole numbers of 8 bits, two rows at a time.

With a vector of float32, each stored number must be converted, which takes longer than its product. Here the vector's
numbers are rounded to 16 bits of the largest, so that all are whole numbers: one instruction multiplies pairs of them
and adds the products. Of each row, rounding loses at most 1/65534 of what the largest number could add.
"""

from collections.abc import Callable
from typing import no_type_check

import llvmlite.binding
import numpy as np
from jaxtyping import Int8
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.errors import TypingError
from numba.core.typing.templates import Signature
from numba.extending import intrinsic

from replicate.approximation.kernels.vector_code import INDEX, data
from replicate.engine.jit_cache import KEEP_CODE
from replicate.inference.row_products import NOTHING

BLOCK = 64  # columns at a time, whose sums stay in registers
LARGEST = 32_767  # of 16 bits
ROOM = (2**31 - 1) // 128  # what 32 bits hold of products with 8 bits
LANES = 8  # sums of a register
PAIR, SUMS = ir.VectorType(ir.IntType(16), 2 * LANES), ir.VectorType(ir.IntType(32), LANES)
X86 = "llvm.x86.avx2.pmadd.wd"


def has_pair_instruction() -> bool:
    """Return whether this processor multiplies and adds pairs in one instruction that LLVM has a name for."""
    return bool(llvmlite.binding.get_host_cpu_features().get("avx2"))


def in_pairs(rows: Int8[np.ndarray, "k w"]) -> np.ndarray:
    """Return a matrix's numbers as `add_pairs` reads them: flat, [block of columns, pair of rows, column, row].

    Zeros fill the last block, and the last pair of an odd number of rows.
    """
    count, width = rows.shape
    full = np.zeros((count + count % 2, padded(width)), np.int8)
    full[:count, :width] = rows
    return full.reshape(len(full) // 2, 2, padded(width) // BLOCK, BLOCK).transpose(2, 0, 3, 1).ravel()


@njit(inline="always")
@no_type_check
def padded(width: int) -> int:
    """Return how many columns the blocks of so many columns have."""
    return (width + BLOCK - 1) // BLOCK * BLOCK


@intrinsic
def _sum_block(
    typing: object, weights: types.Array, first: types.Integer, pairs: types.Array, count: types.Integer,
    sums: types.Array,
) -> tuple[Signature, Callable]:  # fmt: skip
    """Write the sums over `count` pairs of one block's products, whose numbers lie in `weights` from `first` on.

    weights: int8, as of `in_pairs`. pairs: int32, each two numbers of 16 bits, the first in the lower half. sums:
    int32.
    """
    kinds = weights.dtype, pairs.dtype, sums.dtype
    if kinds != (types.int8, types.int32, types.int32):
        raise TypingError(f"weights, pairs and sums are {kinds}: allowed are int8, int32 and int32")

    def generate(context, builder, signature, args):
        kinds = signature.args
        numbers = builder.gep(data(context, builder, kinds[0], args[0]), [args[1]])
        two, out = data(context, builder, kinds[2], args[2]), data(context, builder, kinds[4], args[4])
        totals = [cgutils.alloca_once_value(builder, ir.Constant(SUMS, None)) for _ in range(BLOCK // LANES)]
        with cgutils.for_range(builder, args[3], intp=INDEX) as loop:
            both = builder.load(builder.gep(two, [loop.index]))
            one = builder.insert_element(ir.Constant(SUMS, ir.Undefined), both, ir.Constant(ir.IntType(32), 0))
            zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
            factors = builder.bitcast(builder.shuffle_vector(one, ir.Constant(SUMS, ir.Undefined), zeros), PAIR)
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
    """Return for each pair of numbers of 16 bits the sum of the two products, in 32 bits."""
    if has_pair_instruction():
        kind = ir.FunctionType(SUMS, [PAIR, PAIR])
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, X86), (left, right))
    products = []
    for first in range(2):
        places = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [2 * k + first for k in range(LANES)])
        halves = (builder.shuffle_vector(each, ir.Constant(PAIR, ir.Undefined), places) for each in (left, right))
        products.append(builder.mul(*(builder.sext(half, SUMS) for half in halves)))
    return builder.add(*products)


@njit(cache=KEEP_CODE, error_model="numpy", nogil=True)
@no_type_check
def add_pairs(x: np.ndarray, weights: np.ndarray, first: int, width: int, out: np.ndarray, pairs: np.ndarray) -> int:
    """Add x @ w to `out` (width,), where w lies in flat `weights` from `first` on as `in_pairs` stores it.

    pairs: scratch of int32 for BLOCK numbers and one for each pair of x. Returns where the matrix ends. Where x has a
    number that isn't finite, nothing of `out` is.
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
    whole = np.float32(min(LARGEST, ROOM // len(x)))  # the largest's whole number: no sum can overflow
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
