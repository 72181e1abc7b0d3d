"""Any small torch network as ONNX operators: the functions of torch that it calls are written down while it runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import torch
from torch import nn
from torch.overrides import TorchFunctionMode

from replicate.base.exceptions import InputError
from replicate.deployment.onnx_graph import OnnxGraph

POSES = 2  # that a network is run on; no shape in the graph depends on it


def recorded(network: nn.Module, graph: OnnxGraph, params: str, count: int) -> str:
    """Return the value of a network's output; `params` is the value of its scaled parameters (b, count).

    Raises InputError for a network that calls a function of torch that `CONVERTERS` lacks, or with arguments that the
    converter doesn't know.
    """
    example = torch.zeros(POSES, count)
    with torch.no_grad(), _Recorder(graph, type(network).__name__) as recorder:
        recorder.follow(example, params)
        return recorder.value(network(example))


class _Recorder(TorchFunctionMode):
    """Adds every call of a torch function that depends on the parameters to a graph."""

    def __init__(self, graph: OnnxGraph, name: str):
        super().__init__()
        self.graph, self._name = graph, name
        self._values: dict[int, str] = {}  # by the id of each tensor that depends on the parameters
        self._tensors: list[torch.Tensor] = []  # kept, so that no other tensor gets the id of one

    def follow(self, tensor: torch.Tensor, value: str) -> None:
        self._values[id(tensor)] = value
        self._tensors.append(tensor)

    def follows(self, operand: torch.Tensor) -> bool:
        """Return whether a tensor depends on the parameters."""
        return id(operand) in self._values

    def value(self, operand: torch.Tensor | float) -> str:
        """Return the value of a tensor or a number; a tensor that depends on no parameter is a weight."""
        if id(operand) in self._values:
            return self._values[id(operand)]
        if isinstance(operand, torch.Tensor):
            return self.graph.weight(operand.detach().cpu().numpy())
        return self.graph.constant(float(operand))

    def __torch_function__(self, function: Callable, types: object, args: tuple = (), kwargs: dict | None = None):
        kwargs = kwargs or {}
        result = function(*args, **kwargs)
        if any(id(tensor) in self._values for tensor in _tensors((*args, *kwargs.values()))):
            results = _tensors((result,))
            if results:
                name = getattr(function, "__name__", "").strip("_")
                if name not in CONVERTERS:
                    raise self.unknown(name)
                try:
                    values = CONVERTERS[name](self, *args, **kwargs)
                except TypeError as error:  # a converter has the arguments that it knows, and no others
                    raise self.unknown(f"{name} with {', '.join(kwargs) or 'such arguments'}") from error
                for tensor, value in zip(results, [values] if isinstance(values, str) else values, strict=True):
                    self.follow(tensor, value)
        return result

    def unknown(self, name: str) -> InputError:
        """Return the error of a function that has no operator here."""
        known = ", ".join(sorted(CONVERTERS))
        return InputError(f"{self._name} calls torch's {name}, which has no ONNX operator here; there are {known}")


def _tensors(values: Sequence[object]) -> list[torch.Tensor]:
    found = []
    for value in values:
        found += _tensors(value) if isinstance(value, list | tuple) else [value]
    return [value for value in found if isinstance(value, torch.Tensor)]


def _linear(recorder: _Recorder, x: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor | None = None) -> str:
    ends = () if bias is None else (recorder.value(bias),)
    return recorder.graph.node("Gemm", recorder.value(x), recorder.value(weight), *ends, transB=1)


def _addmm(recorder: _Recorder, bias: torch.Tensor, x: torch.Tensor, matrix: torch.Tensor) -> str:
    return recorder.graph.node("Gemm", *map(recorder.value, (x, matrix, bias)))


def _leaky_relu(recorder: _Recorder, x: torch.Tensor, negative_slope: float = 0.01, inplace: bool = False) -> str:
    return recorder.graph.node("LeakyRelu", recorder.value(x), alpha=float(negative_slope))


def _silu(recorder: _Recorder, x: torch.Tensor, inplace: bool = False) -> str:
    value = recorder.value(x)
    return recorder.graph.node("Mul", value, recorder.graph.node("Sigmoid", value))


def _relu(recorder: _Recorder, x: torch.Tensor, inplace: bool = False) -> str:
    return recorder.graph.node("Relu", recorder.value(x))


def _square(recorder: _Recorder, x: torch.Tensor) -> str:
    value = recorder.value(x)
    return recorder.graph.node("Mul", value, value)


def _unflatten(recorder: _Recorder, x: torch.Tensor, dim: int, sizes: Sequence[int]) -> str:
    dim %= x.ndim
    sizes = x.unflatten(dim, sizes).shape[dim:] if dim else [*sizes, *x.shape[1:]]
    return recorder.graph.reshape(recorder.value(x), [*[0] * dim, *sizes])


def _chunk(recorder: _Recorder, x: torch.Tensor, chunks: int, dim: int = 0) -> tuple[str, ...]:
    width = math.ceil(x.shape[dim] / chunks)
    lengths = [min(width, x.shape[dim] - first) for first in range(0, x.shape[dim], width)]
    return recorder.graph.nodes(
        "Split", len(lengths), recorder.value(x), recorder.graph.integers(np.array(lengths)), axis=dim
    )


def _unbind(recorder: _Recorder, x: torch.Tensor, dim: int = 0) -> tuple[str, ...]:
    dim %= x.ndim
    parts = recorder.graph.nodes("Split", x.shape[dim], recorder.value(x), axis=dim)
    return tuple(recorder.graph.node("Squeeze", part, recorder.graph.integers([dim])) for part in parts)


def _cat(recorder: _Recorder, tensors: Sequence[torch.Tensor], dim: int = 0) -> str:
    return recorder.graph.node("Concat", *map(recorder.value, tensors), axis=dim)


def _stack(recorder: _Recorder, tensors: Sequence[torch.Tensor], dim: int = 0) -> str:
    place = recorder.graph.integers([dim])
    parts = [recorder.graph.node("Unsqueeze", recorder.value(tensor), place) for tensor in tensors]
    return recorder.graph.node("Concat", *parts, axis=dim)


def _getitem(recorder: _Recorder, x: torch.Tensor, index: object) -> str:
    """Convert indices that only add dimensions, as x[:, None] or x[..., None]."""
    index = index if isinstance(index, tuple) else (index,)
    if not all(entry is None or entry is Ellipsis or entry == slice(None) for entry in index):
        raise recorder.unknown("getitem, but to add dimensions")
    after = index.index(Ellipsis) if Ellipsis in index else len(index)
    left = x.ndim - sum(entry == slice(None) for entry in index)
    whole = [*index[:after], *[slice(None)] * left, *index[after + 1 :]]
    axes = [place for place, entry in enumerate(whole) if entry is None]
    return recorder.graph.node("Unsqueeze", recorder.value(x), recorder.graph.integers(axes))


def _index_select(recorder: _Recorder, x: torch.Tensor, dim: int, index: torch.Tensor) -> str:
    return recorder.graph.gather(recorder.value(x), index.numpy(), dim)


def _transpose(recorder: _Recorder, x: torch.Tensor, dim0: int, dim1: int) -> str:
    order = list(range(x.ndim))
    order[dim0], order[dim1] = order[dim1], order[dim0]
    return recorder.graph.node("Transpose", recorder.value(x), perm=order)


def _squeeze(recorder: _Recorder, x: torch.Tensor, dim: int | Sequence[int]) -> str:
    return recorder.graph.node("Squeeze", recorder.value(x), recorder.graph.integers(np.atleast_1d(dim)))


def _flatten(recorder: _Recorder, x: torch.Tensor, start_dim: int = 0, end_dim: int = -1) -> str:
    start_dim, end_dim = start_dim % x.ndim, end_dim % x.ndim
    size = math.prod(x.shape[start_dim : end_dim + 1]) if start_dim else -1
    return recorder.graph.reshape(recorder.value(x), [*[0] * start_dim, size, *x.shape[end_dim + 1 :]])


def _matmul(recorder: _Recorder, left: torch.Tensor, right: torch.Tensor) -> str:
    """Convert a product. A constant on the left is repeated (see `for_each_pose`) or put to the right if large."""
    graph, factor = recorder.graph, recorder.value(right)
    if recorder.follows(left) or right.ndim < 3:
        return graph.node("MatMul", recorder.value(left), factor)
    if left.ndim > 2 or right.ndim > 3:
        constant = graph.for_each_pose(left.detach().cpu().numpy(), graph.sum(factor, right.ndim - 2, right.ndim - 1))
        return graph.node("MatMul", constant, factor)
    columns = graph.reshape(graph.node("Transpose", factor, perm=[0, 2, 1]), [-1, right.shape[1]])
    products = graph.node("MatMul", columns, recorder.value(left.T.contiguous()))
    return graph.node("Transpose", graph.reshape(products, [-1, right.shape[2], len(left)]), perm=[0, 2, 1])


def _sum(recorder: _Recorder, x: torch.Tensor, dim: int | Sequence[int], keepdim: bool = False) -> str:
    axes = (np.atleast_1d(dim) % x.ndim).tolist()  # onnxruntime-web overlooks negative ones where there are no poses
    return recorder.graph.sum(recorder.value(x), *axes, keep=keepdim)


def _ones_like(recorder: _Recorder, x: torch.Tensor) -> str:
    return recorder.graph.node("Add", _zeros_like(recorder, x), recorder.graph.constant(1))


def _zeros_like(recorder: _Recorder, x: torch.Tensor) -> str:
    return recorder.graph.node("Mul", recorder.value(x), recorder.graph.constant(0))


def _from_right(recorder: _Recorder, x: torch.Tensor, other: torch.Tensor | float) -> str:
    return recorder.graph.node("Sub", recorder.value(other), recorder.value(x))


def _pointwise(operator: str) -> Callable:
    def convert(recorder: _Recorder, *operands: torch.Tensor | float) -> str:
        return recorder.graph.node(operator, *map(recorder.value, operands))

    return convert


ALIKE = ("add", "mul", "sub", "div", "neg", "pow", "abs", "sqrt", "sin", "cos", "tanh", "sigmoid", "where")
CONVERTERS = {
    "linear": _linear,
    "addmm": _addmm,
    "leaky_relu": _leaky_relu,
    "relu": _relu,
    "silu": _silu,
    "square": _square,
    "unflatten": _unflatten,
    "flatten": _flatten,
    "chunk": _chunk,
    "unbind": _unbind,
    "cat": _cat,
    "stack": _stack,
    "getitem": _getitem,
    "index_select": _index_select,
    "squeeze": _squeeze,
    "transpose": _transpose,
    "sum": _sum,
    "ones_like": _ones_like,
    "zeros_like": _zeros_like,
    "rsub": _from_right,
    "lt": _pointwise("Less"),
    "minimum": _pointwise("Min"),
    "maximum": _pointwise("Max"),
    "matmul": _matmul,
    **{name: _pointwise(name.capitalize()) for name in ALIKE},
}
