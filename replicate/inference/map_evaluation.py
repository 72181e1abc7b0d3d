"""Map networks, one pose at a time on one thread: the pixels that `MapPlan` lists, and nothing else."""

from collections.abc import Sequence
from typing import no_type_check

import numpy as np
from jaxtyping import Float32
from numba import njit

from replicate.approximation.cnn import START
from replicate.approximation.kernels.map_kernel import REORDER, read_vertex
from replicate.approximation.kernels.pixel_kernel import TILE, multiply_pixels
from replicate.approximation.kernels.vector_code import CHANNELS
from replicate.approximation.model import SegmentedModel
from replicate.engine.jit_cache import KEEP_CODE
from replicate.inference.map_plan import MapPlan, plan_maps
from replicate.inference.map_program import program_of
from replicate.inference.row_products import NOTHING, add_products
from replicate.inference.work import Work, of_layers, total

PIXELS = START**2


@njit(cache=KEEP_CODE, error_model="numpy", fastmath=REORDER, nogil=True)
@no_type_check
def _read(image, pixels, below, shares, weight, bias, vertices, out):
    """Add to `out` (n, 3) what vertices read bilinearly from an image, through the 1×1 convolution."""
    for i in range(len(pixels)):
        at = pixels[i]
        upper, lower = image[at : at + 2 * CHANNELS], image[at + below : at + below + 2 * CHANNELS]
        x, y, z = read_vertex(upper, lower, shares[i], weight)
        vertex = vertices[i]
        out[vertex, 0] += x + bias[0]
        out[vertex, 1] += y + bias[1]
        out[vertex, 2] += z + bias[2]


@njit(cache=KEEP_CODE, error_model="numpy", nogil=True)
@no_type_check
def _add_offsets(program, params, images, sums, rows, out):
    """Add to `out` (n, 3) the offsets of all networks' vertices, mm, for raw rig parameters (m,).

    images: scratch of `program.memory` zeros; their borders stay zero. sums: (2, widest), rows: as many as sums.
    """
    facts, numbers, places = program.facts, program.numbers, program.places
    f, weight, n, p = NOTHING, NOTHING, NOTHING, NOTHING  # how far each of the arrays has been read
    for network in range(len(program.slopes)):
        slope = program.slopes[network]
        inputs, layers = facts[f], facts[f + 1]
        x = params[places[p : p + inputs]]
        f, p = f + 2, p + inputs
        for layer in range(layers):
            width = facts[f]
            y = sums[layer % 2, :width]
            y[:] = numbers[n : n + width]
            add_products(x, program.weights, weight, width, y, rows)
            if layer + 1 < layers:
                for k in range(width):
                    y[k] = max(y[k], slope * y[k])
            f, n, weight = f + 1, n + width, weight + len(x) * width
            x = y
        channels, first_image, layers = facts[f], facts[f + 1], facts[f + 2]
        image = images[first_image:]
        for k in range(PIXELS):
            start = places[p + k]
            image[start : start + channels] = x[k * channels : (k + 1) * channels]
        f, p = f + 3, p + PIXELS
        for _ in range(layers):
            shown = images[facts[f] :]
            parities, taps = facts[f + 1], facts[f + 2]
            f += 3
            block, count = taps * channels * CHANNELS, facts[f + parities - 1]
            bias = numbers[n + parities * block : n + parities * block + CHANNELS]
            sources = places[p + parities * taps : p + parities * taps + count]
            targets = places[p + parities * taps + count : p + parities * taps + 2 * count]
            first = 0
            for parity in range(parities):
                own = numbers[n + parity * block : n + (parity + 1) * block]
                offsets = places[p + parity * taps : p + (parity + 1) * taps]
                for place in range(first, facts[f + parity], TILE):
                    multiply_pixels(shown, targets, image, sources, place, offsets, own, channels, bias, slope)
                first = facts[f + parity]
            f, n, p = f + parities, n + parities * block + CHANNELS, p + parities * taps + 2 * count
            image, channels = shown, CHANNELS
        count, below = facts[f], facts[f + 1]
        weights = numbers[n : n + 3 * CHANNELS].reshape(3, CHANNELS)
        n += 3 * CHANNELS
        shares = numbers[n + 3 : n + 3 + 4 * count].reshape(count, 4)
        vertices = places[p + count : p + 2 * count]
        _read(image, places[p : p + count], below, shares, weights, numbers[n : n + 3], vertices, out)
        f, n, p = f + 2, n + 3 + 4 * count, p + 2 * count


class FastMaps:
    """The map networks of a coarse or refined model, side by side, one pose at a time."""

    def __init__(self, plans: Sequence[MapPlan], halves: bool = False):
        self._plans, self._program = tuple(plans), program_of(plans, halves)
        self._images = np.zeros(self._program.memory, np.float32)
        self._sums = np.zeros((2, self._program.widest), np.float32)
        widest = max(self._program.widest, *(len(plan.parameters) for plan in plans), 0)
        self._rows = np.zeros(widest, np.int64)

    def place(self, params: Float32[np.ndarray, " m"], out: Float32[np.ndarray, "n 3"]) -> None:
        """Add all networks' offsets (mm) for raw rig parameters to `out`."""
        _add_offsets(self._program, params, self._images, self._sums, self._rows, out)

    def work(self, params: Float32[np.ndarray, " m"]) -> Work:
        """Return what the pose of some raw rig parameters costs."""
        program, size = self._program, self._program.weights.itemsize
        parts = [Work(0, program.numbers.nbytes + program.places.nbytes)]
        for plan in self._plans:
            parts.append(of_layers(params[plan.parameters], [len(bias) for bias in plan.weight_biases], size))
            depths = [plan.depth, *[CHANNELS] * (len(plan.taps) - 1)]
            pixels = zip(plan.sources, plan.offsets, depths, strict=True)
            products = sum(len(places) * offsets.shape[1] * depth * CHANNELS for places, offsets, depth in pixels)
            parts.append(Work(products + len(plan.vertices) * (4 + 3) * CHANNELS, 0))
        return total(parts)


def fast_maps(models: Sequence[SegmentedModel], halves: bool = False) -> FastMaps:
    """Return the fast evaluation of models of map networks, whose offsets add."""
    parts = [
        (model, *each) for model in models for each in zip(model.networks, model.segments, model.lengths, strict=True)
    ]
    plans = [
        plan_maps(network, segment.parameters, segment.vertices, model.scale.numpy(), length)
        for model, network, segment, length in parts
    ]
    return FastMaps(plans, halves)
