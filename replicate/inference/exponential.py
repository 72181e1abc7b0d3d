"""e to the power of a float32 in plain arithmetic, which a compiler turns into vector instructions.

Numba calls a library for each exponential by itself, which takes a layer of 128 gates several times as long.
"""

from collections.abc import Callable
from typing import no_type_check

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core.typing.templates import Signature
from numba.extending import intrinsic

LOG2_E = np.float32(np.log2(np.e))
LARGEST = np.float32(126)  # powers of 2 beyond ± this are taken for it, near the ends of float32
BIAS, MANTISSA = np.int32(127), np.int32(23)  # of float32's exponent, and the number of bits below it
# 2^f for f within ± 1/2, by powers of f: Chebyshev's fit of degree 5, off by 8e-8 of the value at most.
C0, C1, C2, C3, C4, C5 = (
    np.float32(c) for c in (1.00000007, 0.69314695, 0.24022122, 0.05550743, 0.00967546, 0.00132670)
)


@intrinsic
def _from_bits(typing: object, value: types.Type) -> tuple[Signature, Callable]:
    """Return the float32 whose bits an int32 has."""

    def generate(context, builder, signature, args):
        return builder.bitcast(args[0], ir.FloatType())

    return types.float32(types.int32), generate


@njit(inline="always")
@no_type_check
def exponential(x: np.float32) -> np.float32:
    """Return e^x of a float32, to 4e-6 of its value, near zero to 4e-7; beyond ± 87 it is e^± 87."""
    power = min(max(x * LOG2_E, -LARGEST), LARGEST)
    whole = np.floor(power + np.float32(0.5))
    f = power - whole
    fraction = C0 + f * (C1 + f * (C2 + f * (C3 + f * (C4 + f * C5))))
    return fraction * _from_bits((np.int32(whole) + BIAS) << MANTISSA)
