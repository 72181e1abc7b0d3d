"""A graph of ONNX operators while it is put together: arrays go in, names of values come out.

Torch's own exporters were tried on a network (torch 2.13): one turns weights of 16 bits into constants of 32, so that
the file is twice as large, and the other needs onnxscript.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import onnx
from onnx import helper, numpy_helper

OPSET = 15  # the latest that Unity reads before its Sentis 2.6
IR_VERSION = 8  # that of opset 15


class OnnxGraph:
    """Operators and weights in the order in which they are added; a value goes by its name.

    half: whether weights are stored in 16 bits. They become 32 again before anything is computed, once, when a runtime
    folds constants, so that sums lose nothing.
    """

    def __init__(self, half: bool = False):
        self._half = half
        self._nodes: list[onnx.NodeProto] = []
        self._weights: list[onnx.TensorProto] = []

    def weight(self, values: np.ndarray) -> str:
        """Return the value of a trained array, which is float32 wherever it is used.

        Arrays of int8 and int16 are stored as they are.
        """
        values = np.asarray(values)
        if values.dtype.kind == "f":
            values = values.astype(np.float16 if self._half else np.float32)
        name = self._store(values)
        return name if values.dtype == np.float32 else self.cast(name)

    def constant(self, values: np.ndarray | Sequence[float] | float) -> str:
        """Return the value of an array that is always stored as float32, since geometry depends on it."""
        return self._store(np.asarray(values, np.float32))

    def integers(self, values: np.ndarray | Sequence[int] | int) -> str:
        """Return the value of indices, axes or a shape."""
        return self._store(np.asarray(values, np.int64))

    def cast(self, value: str) -> str:
        """Return a value as float32."""
        return self.node("Cast", value, to=onnx.TensorProto.FLOAT)

    def node(self, operator: str, *inputs: str, **attributes: object) -> str:
        """Add an operator of one output; return that output."""
        (output,) = self.nodes(operator, 1, *inputs, **attributes)
        return output

    def nodes(self, operator: str, outputs: int, *inputs: str, **attributes: object) -> tuple[str, ...]:
        """Add an operator; return its outputs."""
        first = len(self._nodes)
        names = tuple(f"{operator.lower()}_{first}{f'_{k}' if outputs > 1 else ''}" for k in range(outputs))
        self._nodes.append(helper.make_node(operator, inputs, names, f"{operator}_{first}", **attributes))
        return names

    def reshape(self, value: str, shape: list[int]) -> str:
        """Return a value in another shape; 0 keeps a dimension.

        −1 is what is left; beside a 0, runtimes can't tell how much that is where there are no poses.
        """
        return self.node("Reshape", value, self.integers(shape))

    def for_each_pose(self, constant: np.ndarray, value: str) -> str:
        """Return a constant repeated along the first dimension of a value (b, …), beside which it can be added.

        A product of matrices whose left factor lacks that dimension fails in onnxruntime-web where there are no poses.
        """
        return self.node("Add", self.constant(constant), self.node("Mul", value, self.constant(0)))

    def gather(self, value: str, indices: np.ndarray, axis: int) -> str:
        """Return some entries of a value along an axis."""
        return self.node("Gather", value, self.integers(indices), axis=axis)

    def sum(self, value: str, *axes: int, keep: bool = True) -> str:
        """Return sums along some axes, which stay, of length 1, unless `keep` is False."""
        return self.node("ReduceSum", value, self.integers(axes), keepdims=int(keep))

    def reduce(self, operator: str, value: str, *axes: int, keep: bool = True) -> str:
        """Return the same of another reduction: at this opset its axes are an attribute."""
        return self.node(operator, value, axes=axes, keepdims=int(keep))

    def model(
        self, source: tuple[str, list], result: str, target: tuple[str, list], about: dict[str, str], words: str
    ) -> onnx.ModelProto:
        """Return the whole graph, checked.

        source: the input's name and shape, where a word is a free dimension
        result: the value that becomes the output
        target: the output's name and shape
        about: metadata
        words: what the model is, in a sentence
        """
        self._nodes.append(helper.make_node("Identity", [result], [target[0]], "result"))
        ends = [helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, shape) for name, shape in (source, target)]
        graph = helper.make_graph(self._nodes, "approximation", ends[:1], ends[1:], self._weights, words)
        opset = helper.make_opsetid("", OPSET)
        model = helper.make_model(graph, opset_imports=[opset], ir_version=IR_VERSION, producer_name="replicate")
        helper.set_model_props(model, about)
        onnx.checker.check_model(model, full_check=True)
        return model

    def _store(self, values: np.ndarray) -> str:
        name = f"weight_{len(self._weights)}"
        self._weights.append(numpy_helper.from_array(np.asarray(values, order="C"), name))
        return name
