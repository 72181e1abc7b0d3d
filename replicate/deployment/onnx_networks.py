"""One segment's network as ONNX operators: scaled parameters (b, j) → offsets (b, k, 3)."""

from functools import singledispatch

import numpy as np
from torch import nn

from replicate.approximation.cnn import START, MapNetwork
from replicate.approximation.linear_skip import WithLine
from replicate.deployment.onnx_functions import recorded
from replicate.deployment.onnx_graph import OnnxGraph


@singledispatch
def add_network(network: nn.Module, graph: OnnxGraph, params: str, count: int) -> str:
    """Return the value of a network's offsets (b, k, 3), in units of its own.

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
            "Resize", x, "", graph.number([1, 1, 2, 2]),
            mode="nearest", coordinate_transformation_mode="asymmetric", nearest_mode="floor",
        )  # fmt: skip
        x = _convolution(layer, graph, x, network.slope)
    x = _convolution(network.last, graph, x, network.slope)
    x = graph.node("Conv", x, *map(graph.weight, _arrays(network.output)), kernel_shape=[1, 1])
    maps = graph.node("Transpose", graph.reshape(x, [0, 0, network.map_size**2]), perm=[0, 2, 1])  # (b, size², 3)
    read = graph.gather(maps, network.pixels.numpy().T, 1)  # (b, 4, k, 3)
    shares = network.shares.numpy().T[:, :, None]
    shares = graph.node(
        "Expand", graph.number(shares), graph.whole([*shares.shape[:2], 3])
    )  # at once, and not each time
    return graph.node("ReduceSum", graph.node("Mul", read, shares), graph.whole([1]), keepdims=0)


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
