"""Products of a vector with the rows of a matrix, read from memory as few bytes: float32, float16, int16 or int8.

One pose reads every weight once, so that a product costs what its weight costs to fetch. Rows of zeros are skipped:
most rig parameters of a pose are zero. NumPy's float16 is no type of Numba's; its bits come as uint16.
"""

from collections.abc import Callable
from typing import no_type_check

import llvmlite.binding
import numpy as np
from jaxtyping import Float
from llvmlite import ir
from numba import njit, types
from numba.core.errors import TypingError
from numba.core.typing.templates import Signature
from numba.extending import intrinsic

from replicate.approximation.kernels.map_kernel import REORDER
from replicate.engine.jit_cache import KEEP_CODE

ROWS = 8  # at a time, so that sums are loaded and stored less often
COLUMNS = 4_096  # at a time, so that sums stay in the nearest cache
NOTHING = np.int64(0)  # where a place starts: the literal 0 would have functions compiled once more for it


def has_halves() -> bool:
    """Return whether this processor reads float16."""
    features = llvmlite.binding.get_host_cpu_features()
    return bool(features.get("f16c", "x86" not in llvmlite.binding.get_process_triple()))


def without_loss(weights: Float[np.ndarray, "..."], halves: bool | None = None) -> np.ndarray:
    """Return weights as the products read them: the bits of float16 where that loses nothing, else float32.

    halves: True for float16 whatever it loses, if all fit into its range. A processor that can't read float16 gets
    float32.
    """
    exact = np.asarray(weights, np.float32)
    with np.errstate(over="ignore"):
        short = exact.astype(np.float16)
    fits = np.isfinite(short).all() if halves else (short == exact).all()
    return short.view(np.uint16) if has_halves() and fits else exact


@intrinsic
def as_float32(typing: object, value: types.Type) -> tuple[Signature, Callable]:
    """Return a stored number as float32; uint16 holds the bits of a float16."""
    if value not in (types.float32, types.uint16, types.int16, types.int8):
        raise TypingError(f"weights are {value}: allowed are float32, uint16 (bits of float16), int16 and int8")

    def generate(context, builder, signature, args):
        if value == types.float32:
            return args[0]
        if value == types.uint16:
            return builder.fpext(builder.bitcast(args[0], ir.HalfType()), ir.FloatType())
        return builder.sitofp(args[0], ir.FloatType())

    return types.float32(value), generate


@njit(cache=KEEP_CODE, error_model="numpy", fastmath=REORDER, nogil=True)
@no_type_check
def add_products(x: np.ndarray, weights: np.ndarray, first: int, width: int, out: np.ndarray, rows: np.ndarray) -> None:
    """Add x @ w to `out` (width,), where w are the rows of `width` numbers that lie in flat `weights` from `first` on.

    rows: scratch for as many indices as x has numbers.
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
