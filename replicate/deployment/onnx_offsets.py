"""A whole model as ONNX operators: raw rig parameters (b, m) → offsets in mm of the vertices that it moves."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import singledispatch

import numpy as np
from torch import nn

from replicate.approximation.cnn import START, MapNetwork
from replicate.approximation.model import SegmentedModel
from replicate.approximation.refinement import RefinedModel
from replicate.base.exceptions import InputError
from replicate.baselines.line import WithLine
from replicate.deployment.onnx_functions import recorded
from replicate.deployment.onnx_graph import OnnxGraph
from replicate.regional.model import RegionalModel, StoredBasis


@dataclass(frozen=True)
class Moved:
    """What a model moves. offsets: a value (b, v, 3), mm. vertices: (v,), indices into the mesh, each once."""

    offsets: str
    vertices: np.ndarray


@singledispatch
def add_offsets(model: object, graph: OnnxGraph, params: str) -> Moved:
    """Return the offsets that a model gives for raw rig parameters, the value `params` (b, m).

    Raises InputError for a model of any other class, and as `onnx_functions.recorded` does.
    """
    raise InputError(
        f"{type(model).__name__} can't be written as ONNX: expected a SegmentedModel, RefinedModel or RegionalModel"
    )


@add_offsets.register
def _(model: SegmentedModel, graph: OnnxGraph, params: str) -> Moved:
    scale = model.scale.cpu().numpy()
    scaled = graph.node("Div", params, graph.constant(scale))
    parts = []
    for network, segment, length in zip(model.networks, model.segments, model.lengths, strict=True):
        seen = segment.parameters
        whole = np.array_equal(seen, np.arange(len(scale)))
        inputs = scaled if whole else graph.gather(scaled, seen, 1)
        offsets = add_network(network, graph, inputs, len(seen))
        parts.append(offsets if length == 1 else graph.node("Mul", offsets, graph.constant(length)))
    return Moved(graph.node("Concat", *parts, axis=1), model.vertices)


@add_offsets.register
def _(model: RefinedModel, graph: OnnxGraph, params: str) -> Moved:
    coarse, residual = add_offsets(model.coarse, graph, params), add_offsets(model.residual, graph, params)
    place = places(residual.vertices, coarse.vertices)
    more = graph.gather(padded(graph, residual.offsets, 1), place, 1)
    return Moved(graph.node("Add", coarse.offsets, more), coarse.vertices)


@add_offsets.register
def _(model: RegionalModel, graph: OnnxGraph, params: str) -> Moved:
    scale, counts = model.scale.numpy(), [len(basis.steps) for basis in model.bases]
    scaled = graph.node("Div", params, graph.constant(scale))
    shares = []
    for network, parameters in zip(model.network.networks, model.network.seen, strict=True):
        seen = parameters.numpy()
        inputs = scaled if len(seen) == len(scale) else graph.gather(scaled, seen, 1)
        shares.append(graph.node("Mul", recorded(network, graph, inputs, len(seen)), graph.constant(model.length)))
    if len(shares) < len(counts):
        shares = graph.nodes("Split", len(counts), *shares, graph.integers(counts), axis=1)
    parts = [_region(basis, graph, share) for basis, share in zip(model.bases, shares, strict=True)]
    count = sum(len(basis.vertices) for basis in model.bases)
    rows = graph.reshape(graph.node("Concat", *parts, axis=1), [0, count, 3])
    return Moved(_summed(rows, graph, model.layers), model.vertices)


def _region(basis: StoredBasis, graph: OnnxGraph, coefficients: str) -> str:
    """Return a region's offsets (b, 3k), mm; its basis keeps its 8 or 16 bits."""
    steps = basis.steps.numpy()
    stored = [part.flatten(1).numpy() for part in (basis.fine, basis.rough) if len(part)]
    whole = [graph.weight(part) for part in stored]
    whole = whole[0] if len(whole) == 1 else graph.node("Concat", *whole, axis=0)
    components = graph.node("Mul", whole, graph.constant(steps[:, None]))
    mean = graph.weight(basis.mean.flatten().numpy())
    weights = graph.constant(basis.weights.numpy().repeat(3))
    return graph.node("Gemm", coefficients, *(graph.node("Mul", part, weights) for part in (components, mean)))


def _summed(rows: str, graph: OnnxGraph, layers: Sequence[np.ndarray]) -> str:
    """Return each vertex's sum over its rows of all regions (b, r, 3). layers: see `regional.model.coverings`."""
    if len(layers) == 1:
        return rows
    found = graph.gather(rows, layers[-1], 1)
    for layer, following in zip(layers[-2::-1], layers[:0:-1], strict=True):
        both = graph.node("Add", found, graph.gather(rows, layer[: len(following)], 1))
        found = graph.node("Concat", both, graph.gather(rows, layer[len(following) :], 1), axis=1)
    return found


def padded(graph: OnnxGraph, values: str, count: int) -> str:
    """Return values (b, v, 3) with `count` rows of zeros behind them."""
    return graph.node("Pad", values, graph.integers([0, 0, 0, 0, count, 0])) if count else values


def places(vertices: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return the position of each of the `wanted` vertices in `vertices`; len(vertices) where it is missing."""
    place = np.full(max(vertices.max(initial=-1), wanted.max(initial=-1)) + 1, len(vertices))
    place[vertices] = np.arange(len(vertices))
    return place[wanted]


# One segment's network as ONNX operators: scaled parameters (b, j) → offsets (b, k, 3).


@singledispatch
def add_network(network: nn.Module, graph: OnnxGraph, params: str, count: int) -> str:
    """Return the value of a network's offsets (b, k, 3), in the network's unit.

    params: the value of its scaled parameters (b, count). Raises InputError as `recorded` does.
    """
    return recorded(network, graph, params, count)


@add_network.register
def _(network: WithLine, graph: OnnxGraph, params: str, count: int) -> str:
    both = (add_network(part, graph, params, count) for part in (network.network, network.line))
    return graph.node("Add", *both)


@add_network.register
def _(network: MapNetwork, graph: OnnxGraph, params: str, count: int) -> str:
    """Fig. 3 as it is drawn, layer by layer, and the four pixels that each vertex reads."""
    x = _start(network, graph, params)
    for layer in network.upsampled:
        x = graph.node(
            "Resize", x, "", graph.constant([1, 1, 2, 2]),
            mode="nearest", coordinate_transformation_mode="asymmetric", nearest_mode="floor",
        )  # fmt: skip
        x = _convolution(layer, graph, x, network.slope)
    x = _convolution(network.last, graph, x, network.slope)
    x = graph.node("Conv", x, *map(graph.weight, _arrays(network.output)), kernel_shape=[1, 1])
    maps = graph.node("Transpose", graph.reshape(x, [0, 0, network.map_size**2]), perm=[0, 2, 1])  # (b, size², 3)
    read = graph.gather(maps, network.pixels.numpy().T, 1)  # (b, 4, k, 3)
    shares = network.shares.numpy().T[:, :, None]
    shares = graph.node("Expand", graph.constant(shares), graph.integers([*shares.shape[:2], 3]))  # folded once
    return graph.sum(graph.node("Mul", read, shares), 1, keep=False)


def _start(network: MapNetwork, graph: OnnxGraph, params: str) -> str:
    """Return the first map (b, channels, 8, 8); the rows of the last dense layer are sorted, channels first."""
    for layer in network.dense[:-1]:
        weight, bias = map(graph.weight, _arrays(layer))
        params = graph.node("LeakyRelu", graph.node("Gemm", params, weight, bias, transB=1), alpha=network.slope)
    weight, bias = _arrays(network.dense[-1])
    order = np.arange(len(bias)).reshape(START**2, -1).T.ravel()
    flat = graph.node("Gemm", params, graph.weight(weight[order]), graph.weight(bias[order]), transB=1)
    return graph.reshape(flat, [0, len(bias) // START**2, START, START])


def _convolution(layer: nn.Conv2d, graph: OnnxGraph, x: str, slope: float) -> str:
    x = graph.node("Conv", x, *map(graph.weight, _arrays(layer)), kernel_shape=[3, 3], pads=[1, 1, 1, 1])
    return graph.node("LeakyRelu", x, alpha=slope)


def _arrays(layer: nn.Module) -> tuple[np.ndarray, np.ndarray]:
    return layer.weight.detach().cpu().numpy(), layer.bias.detach().cpu().numpy()
