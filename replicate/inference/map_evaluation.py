"""Map networks, one pose at a time on one thread: the rows that `MapPlan` lists, and nothing else."""

from collections.abc import Sequence
from typing import no_type_check

import numpy as np
from numba import njit

from replicate.approximation.kernels.map_kernel import REORDER, read_vertex
from replicate.approximation.kernels.vector_code import CHANNELS
from replicate.engine.jit_cache import KEEP_CODE
from replicate.inference.map_plan import MapPlan
from replicate.inference.pixel_kernel import TILE, multiply_pixels

BLOCK = 4  # inputs at a time, so that sums are loaded and stored less often


def scratch_of(plan: MapPlan) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
    """Return the images and the dense outputs that a plan is evaluated in; the images' borders stay zero."""
    images = tuple(np.zeros(size, np.float32) for size in plan.sizes)
    return images, tuple(np.zeros(len(bias), np.float32) for bias in plan.weight_biases)


@njit(cache=KEEP_CODE, error_model="numpy", fastmath=REORDER, nogil=True)
@no_type_check
def _multiply_rows(x, weight, bias, out):
    """Write bias + x @ weight to `out`; weight is [in, out]."""
    out[:] = bias
    whole = len(x) // BLOCK * BLOCK
    for i in range(0, whole, BLOCK):
        a, b, c, d = x[i], x[i + 1], x[i + 2], x[i + 3]
        wa, wb, wc, wd = weight[i], weight[i + 1], weight[i + 2], weight[i + 3]
        for k in range(len(out)):
            out[k] += a * wa[k] + b * wb[k] + c * wc[k] + d * wd[k]
    for i in range(whole, len(x)):
        for k in range(len(out)):
            out[k] += x[i] * weight[i, k]


@njit(cache=KEEP_CODE, error_model="numpy", nogil=True)
@no_type_check
def _activate(values, slope):
    for k in range(len(values)):
        values[k] = max(values[k], slope * values[k])


@njit(cache=KEEP_CODE, error_model="numpy", fastmath=REORDER, nogil=True)
@no_type_check
def _read(image, plan, out):
    """Add to `out` (n, 3) what the vertices read bilinearly from an image, through the 1×1 convolution."""
    below, weight, bias = plan.below, plan.weight, plan.bias
    for i in range(len(plan.pixels)):
        at = plan.pixels[i]
        upper, lower = image[at : at + 2 * CHANNELS], image[at + below : at + below + 2 * CHANNELS]
        x, y, z = read_vertex(upper, lower, plan.shares[i], weight)
        vertex = plan.vertices[i]
        out[vertex, 0] += x + bias[0]
        out[vertex, 1] += y + bias[1]
        out[vertex, 2] += z + bias[2]


@njit(cache=KEEP_CODE, error_model="numpy", nogil=True)
@no_type_check
def _add_offsets(plan, params, images, outputs, out):
    """Add to `out` (n, 3) the offsets of a network's vertices, mm, for raw rig parameters (m,)."""
    x = params[plan.parameters]
    for layer in range(len(plan.weights)):
        _multiply_rows(x, plan.weights[layer], plan.weight_biases[layer], outputs[layer])
        x = outputs[layer]
        if layer + 1 < len(plan.weights):
            _activate(x, plan.slope)
    for k in range(len(plan.starts)):
        images[0][plan.starts[k] : plan.starts[k] + plan.depth] = x[k * plan.depth : (k + 1) * plan.depth]
    for layer in range(len(plan.taps)):
        channels = plan.depth if layer == 0 else CHANNELS
        offsets, taps = plan.offsets[layer], plan.taps[layer]
        block = offsets.shape[1] * channels * CHANNELS
        first = 0
        for parity in range(len(offsets)):
            own = taps[parity * block : (parity + 1) * block]
            for place in range(first, plan.ends[layer][parity], TILE):
                multiply_pixels(
                    images[layer + 1], plan.targets[layer], images[layer], plan.sources[layer], place,
                    offsets[parity], own, channels, plan.biases[layer], plan.slope,
                )  # fmt: skip
            first = plan.ends[layer][parity]
    _read(images[-1], plan, out)


class FastMaps:
    """The map networks of a coarse or refined model, side by side, one pose at a time."""

    def __init__(self, plans: Sequence[MapPlan]):
        self._parts = [(plan, *scratch_of(plan)) for plan in plans]

    def add(self, params: np.ndarray, out: np.ndarray) -> None:
        """Add all networks' offsets (mm) for raw rig parameters (m,) float32 to `out` (n, 3) float32."""
        for plan, images, outputs in self._parts:
            _add_offsets(plan, params, images, outputs, out)
