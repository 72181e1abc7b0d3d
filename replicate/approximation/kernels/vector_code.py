"""Words for kernels that are written for LLVM directly: arrays, places in them, and vectors of 16 channels."""

from llvmlite import ir
from numba import types
from numba.core.base import BaseContext
from numba.core.errors import TypingError

CHANNELS = 16  # numbers of a vector

INDEX = ir.IntType(64)
VECTOR = ir.VectorType(ir.FloatType(), CHANNELS)


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


def splat(builder: ir.IRBuilder, scalar: ir.Value) -> ir.Value:
    """Return the vector whose numbers all are one scalar."""
    one = builder.insert_element(ir.Constant(VECTOR, ir.Undefined), scalar, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), CHANNELS), [0] * CHANNELS)
    return builder.shuffle_vector(one, ir.Constant(VECTOR, ir.Undefined), zeros)
