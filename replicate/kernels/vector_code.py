"""Words for kernels that are written for LLVM directly: arrays, places in them, and vectors of 16 channels.

Each such kernel has a plain twin of the same name, `…_plain`, a loop in Python that Numba can compile. Where
`REPLICATE_PLAIN_KERNELS` is set the twins run in the kernels' place: slower, and with other last digits.
"""

import os
from collections.abc import Callable

from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.base import BaseContext
from numba.core.errors import TypingError
from numba.extending import intrinsic

from replicate.base.jit_cache import PLAIN_KERNELS

CHANNELS = 16  # numbers of a vector
PLAIN = bool(os.environ.get(PLAIN_KERNELS))

INDEX = ir.IntType(64)
VECTOR = ir.VectorType(ir.FloatType(), CHANNELS)


def twin_of(plain: Callable) -> Callable[[Callable], Callable]:
    """Return the decorator of a kernel in LLVM's words, in whose place its plain twin runs where that is asked for.

    plain: takes the same arguments as the kernel does where it is called.
    """
    return lambda in_llvm: njit(plain) if PLAIN else intrinsic(in_llvm)


def data(context: BaseContext, builder: ir.IRBuilder, kind: types.Array, value: ir.Value) -> ir.Value:
    """Return the pointer to an array's numbers. Raises numba's TypingError for an array that isn't contiguous."""
    if kind.layout != "C":
        raise TypingError("the vector kernels take contiguous arrays only")
    return context.make_array(kind)(context, builder, value).data


def number_at(builder: ir.IRBuilder, pointer: ir.Value, index: ir.Value) -> ir.Value:
    """Return the pointer to a number of an array."""
    return builder.gep(pointer, [index])


def vector(builder: ir.IRBuilder, pointer: ir.Value) -> ir.Value:
    """Return a pointer to a number as one to the vector that begins there."""
    return builder.bitcast(pointer, VECTOR.as_pointer())


def load(builder: ir.IRBuilder, pointer: ir.Value) -> ir.Value:
    """Return the vector that begins at a number."""
    return builder.load(vector(builder, pointer), align=4)


def store(builder: ir.IRBuilder, value: ir.Value, pointer: ir.Value) -> None:
    """Write a vector where a number is, and over the numbers after it."""
    builder.store(value, vector(builder, pointer), align=4)


def place_in(builder: ir.IRBuilder, array: ir.Value, index: ir.Value) -> ir.Value:
    """Return a number of an int32 array, as an index."""
    return builder.sext(builder.load(number_at(builder, array, index)), INDEX)


def check_places(*arrays: types.Array) -> None:
    """Raise numba's TypingError for arrays of places that are not int32."""
    if any(array.dtype != types.int32 for array in arrays):
        raise TypingError("places of pixels are int32")


def length(context: BaseContext, builder: ir.IRBuilder, kind: types.Array, value: ir.Value) -> ir.Value:
    """Return how many entries an array has along its first axis."""
    return builder.extract_value(context.make_array(kind)(context, builder, value).shape, 0)


def variables(builder: ir.IRBuilder, count: int) -> list[ir.Value]:
    """Return vectors that are changed in loops; the compiler keeps them in registers."""
    return [cgutils.alloca_once(builder, VECTOR) for _ in range(count)]


def call(builder: ir.IRBuilder, name: str, *args: ir.Value) -> ir.Value:
    """Return what one of LLVM's own functions of vectors gives."""
    kind = ir.FunctionType(VECTOR, [VECTOR] * len(args))
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{CHANNELS}f32"), args)


def add_product(builder: ir.IRBuilder, total: ir.Value, left: ir.Value, right: ir.Value) -> None:
    """Add a product of two vectors to a variable."""
    builder.store(call(builder, "fma", left, right, builder.load(total)), total)


def splat(builder: ir.IRBuilder, scalar: ir.Value) -> ir.Value:
    """Return the vector whose numbers all are one scalar."""
    one = builder.insert_element(ir.Constant(VECTOR, ir.Undefined), scalar, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), CHANNELS), [0] * CHANNELS)
    return builder.shuffle_vector(one, ir.Constant(VECTOR, ir.Undefined), zeros)
