"""Dense networks and straight lines, one a segment, for one pose at a time on one thread: each weight is read once."""

from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Float32
from numba import njit
from torch import nn

from replicate.approximation.model import SegmentedModel
from replicate.base.jit_cache import kept
from replicate.baselines.dense import DenseNetwork
from replicate.baselines.line import Line
from replicate.inference.products import NOTHING, Work, add_products, of_layers, total, without_loss


class DensePlan(NamedTuple):
    """A model of dense networks in flat arrays: m parameters, s segments, h hidden layers, k vertices in all segments.

    scale: (m,), what parameters are divided by.
    segments: (s, 2), how many parameters and how many vertices each has.
    parameters: those of each segment, one segment after the other.
    vertices: (k,), those of each segment, one segment after the other.
    hidden: (h,), widths of the hidden layers.
    weights: flat, each layer's [in, out] segment by segment, with the length of offsets in mm folded in.
    biases: flat, of the hidden layers.
    places: (3k,), the vertices at rest plus the last layer's bias, mm.
    slopes: (h,), of the leaky ReLUs.
    """

    scale: np.ndarray
    segments: np.ndarray
    parameters: np.ndarray
    vertices: np.ndarray
    hidden: np.ndarray
    weights: np.ndarray
    biases: np.ndarray
    places: np.ndarray
    slopes: np.ndarray


def plan_dense(model: SegmentedModel, neutral: Float32[np.ndarray, "n 3"], halves: bool) -> DensePlan:
    """Return the plan of a model of dense networks, or of lines, on a mesh.

    halves: store weights as float16 even where that rounds.
    """
    weights, biases, places = [], [], []
    for network, segment, length in zip(model.networks, model.segments, model.lengths, strict=True):
        matrices, constants = _layers(network)
        matrices[-1], constants[-1] = matrices[-1] * np.float32(length), constants[-1] * np.float32(length)
        weights += [matrix.ravel() for matrix in matrices]
        biases += constants[:-1]
        places.append(neutral[segment.vertices].ravel() + constants[-1])
    first = model.networks[0]
    hidden = [layer.out_features for layer in first.hidden] if isinstance(first, DenseNetwork) else []
    return DensePlan(
        model.scale.numpy(),
        np.array([(len(s.parameters), len(s.vertices)) for s in model.segments], np.int64),
        np.concatenate([s.parameters for s in model.segments]).astype(np.int64),
        model.vertices.astype(np.int64),
        np.array(hidden, np.int64),
        without_loss(np.concatenate(weights), halves),
        np.concatenate([*biases, np.zeros(0, np.float32)]),
        np.concatenate(places).astype(np.float32),
        np.array(first.slopes if isinstance(first, DenseNetwork) else [], np.float32),
    )


def _layers(network: nn.Module) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return a network's weights, [in, out], and biases, layer by layer."""
    if isinstance(network, Line):
        return [network.weight.detach().numpy()], [network.bias.detach().numpy()]
    layers = [*network.hidden, network.output]
    return [layer.weight.detach().numpy().T for layer in layers], [layer.bias.detach().numpy() for layer in layers]


@kept
@njit(error_model="numpy", nogil=True)
@no_type_check
def place_segments(
    plan: DensePlan, params: np.ndarray, sums: np.ndarray, moved: np.ndarray, rows: np.ndarray, out: np.ndarray
) -> None:
    """Write the vertices of all segments for raw rig parameters.

    plan: of the model.
    params: (m,).
    sums: scratch for hidden layers, (2, widest).
    moved: scratch for the widest output.
    rows: scratch for as many indices as the widest input has numbers.
    out: (n, 3), mm, where the vertices are written to.
    """
    scaled = params / plan.scale
    seen, start, weight, bias = NOTHING, NOTHING, NOTHING, NOTHING
    for inputs, count in plan.segments:
        x = scaled[plan.parameters[seen : seen + inputs]]
        for layer in range(len(plan.hidden)):
            width = plan.hidden[layer]
            y = sums[layer % 2, :width]
            y[:] = plan.biases[bias : bias + width]
            add_products(x, plan.weights, weight, width, y, rows)
            slope = plan.slopes[layer]
            for k in range(width):
                y[k] = max(y[k], slope * y[k])
            weight, bias = weight + len(x) * width, bias + width
            x = y
        y = moved[: 3 * count]
        y[:] = plan.places[3 * start : 3 * (start + count)]
        add_products(x, plan.weights, weight, 3 * count, y, rows)
        for k in range(count):
            vertex = plan.vertices[start + k]
            out[vertex, 0], out[vertex, 1], out[vertex, 2] = y[3 * k], y[3 * k + 1], y[3 * k + 2]
        seen, start, weight = seen + inputs, start + count, weight + len(x) * 3 * count


class FastDense:
    """A model of dense networks, or of lines, on a mesh, one pose at a time."""

    def __init__(self, model: SegmentedModel, neutral: Float32[np.ndarray, "n 3"], halves: bool = False):
        self.plan = plan_dense(model, neutral, halves)
        widest = int(max((*self.plan.hidden, *self.plan.segments[:, 0])))
        self._sums = np.zeros((2, widest), np.float32)
        self._moved = np.zeros(3 * int(self.plan.segments[:, 1].max()), np.float32)
        self._rows = np.zeros(widest, np.int64)

    def place(self, params: Float32[np.ndarray, " m"], out: Float32[np.ndarray, "n 3"]) -> None:
        """Write the vertices of all segments, mm, for raw rig parameters to `out`."""
        place_segments(self.plan, params, self._sums, self._moved, self._rows, out)

    def work(self, params: Float32[np.ndarray, " m"]) -> Work:
        """Return what a pose, given as raw rig parameters, costs."""
        plan, ends = self.plan, np.cumsum(self.plan.segments[:, 0])
        seen = np.split(params[plan.parameters], ends[:-1])
        return total(
            of_layers(inputs, (*plan.hidden.tolist(), 3 * count), plan.weights.itemsize)
            for inputs, count in zip(seen, plan.segments[:, 1].tolist(), strict=True)
        )
