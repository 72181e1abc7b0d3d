"""What one core of this machine can do at most, measured: multiply-adds in float32, and bytes that it reads."""

import time
from collections.abc import Callable
from typing import no_type_check

import llvmlite.binding
import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.typing.templates import Signature
from numba.extending import intrinsic

from replicate.approximation.kernels.map_kernel import REORDER
from replicate.approximation.kernels.vector_code import CHANNELS, INDEX, VECTOR, splat
from replicate.engine.jit_cache import KEEP_CODE

ROUNDS = 200_000  # of the loop of multiply-adds
REPEATS = 15  # of which the best counts: whatever else runs only takes away
WIDE = "avx512f"  # the feature of processors whose registers hold 32 vectors of 16 numbers
SUMS = 12 if llvmlite.binding.get_host_cpu_features().get(WIDE) else 6  # independent, enough to hide how long one takes
MEMORY_BYTES, CACHE_BYTES = 256_000_000, 4_000_000  # far beyond all caches; about what a model's weights take


@intrinsic
def _add_products(typing: object, rounds: types.Type, factor: types.Type) -> tuple[Signature, Callable]:
    """Return the sum of some vectors of numbers that are multiplied and added to, again and again."""

    def generate(context, builder, signature, args):
        fma = cgutils.get_or_insert_function(builder.module, ir.FunctionType(VECTOR, [VECTOR] * 3), "llvm.fma.v16f32")
        value = splat(builder, args[1])
        sums = [cgutils.alloca_once_value(builder, value) for _ in range(SUMS)]
        with cgutils.for_range(builder, args[0], intp=INDEX):
            for total in sums:
                builder.store(builder.call(fma, [builder.load(total), value, value]), total)
        whole = builder.load(sums[0])
        for total in sums[1:]:
            whole = builder.fadd(whole, builder.load(total))
        parts = [builder.extract_element(whole, ir.Constant(ir.IntType(32), k)) for k in range(CHANNELS)]
        result = parts[0]
        for part in parts[1:]:
            result = builder.fadd(result, part)
        return result

    return types.float32(types.int64, types.float32), generate


@njit(cache=KEEP_CODE, nogil=True)
@no_type_check
def _multiply(rounds, factor):
    return _add_products(rounds, factor)


@njit(cache=KEEP_CODE, error_model="numpy", fastmath=REORDER, nogil=True)
@no_type_check
def _read(numbers):
    total = np.float32(0)
    for k in range(len(numbers)):
        total += numbers[k]
    return total


def multiply_adds_per_s() -> float:
    """Return how many float32 multiply-adds one core does in a second, where nothing is read."""
    seconds = _best(lambda: _multiply(ROUNDS, np.float32(0.5)))
    return ROUNDS * SUMS * CHANNELS / seconds


def bytes_per_s(size: int = MEMORY_BYTES) -> float:
    """Return how many bytes one core reads in a second, again and again from an array of `size` bytes."""
    numbers = np.ones(size // 4, np.float32)
    return numbers.nbytes / _best(lambda: _read(numbers))


def _best(call: Callable[[], object]) -> float:
    """Return the least time of some calls, in seconds, after one that compiles."""
    seconds = []
    for _ in range(1 + REPEATS):
        start = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - start)
    return min(seconds[1:])
