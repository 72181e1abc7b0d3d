"""A face as a neutral mesh and shapes: a network gives weights, and the weighted sum of shapes moves every vertex.

V = V⁰ + Σ_k w_k(p) S_k, the form in which engines ship networks: their morph targets are the S_k, and a small ONNX
model has parameters in and weights out. Methods come in it whose last step is a product with fixed shapes. Our method
has them a region each, a PCA network its components, a neural morph model its learned shapes, and a straight line has
one a control, whose weight is the control's distance from its default.

Rigid segments (§3.4) lose nothing. Their carriers give a rotation R about the carriers' centre c at rest, and a shift t
of that centre, and move a vertex x by (x − c) (R − I) + t. That is linear in twelve numbers, the nine of R − I and the
three of t, each with a shape of its own. The graph hands these numbers out as weights.

All weights are 0 at rest, the default of every control, but for what the method itself is off there. That is one more
shape, `rest`, whose weight is always 1, and what the rigid segments make of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, MutableMapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cached_property, singledispatch
from itertools import groupby, product

import numpy as np
import onnx
import torch
from jaxtyping import Float, Float32, Float64, Int
from torch import nn
from torch.nn import functional

from data_recipes.rig import Control
from replicate.approximation.model import SegmentedModel
from replicate.approximation.rigid import Attachments
from replicate.base.exceptions import InputError
from replicate.baselines.dense import DenseNetwork
from replicate.baselines.line import Line
from replicate.deployment.onnx_functions import recorded
from replicate.deployment.onnx_graph import OnnxGraph
from replicate.deployment.onnx_model import PARAMETERS, POSES, drawn_poses, session
from replicate.deployment.onnx_rigid import add_rotations
from replicate.geometry.alignment import align
from replicate.geometry.mesh import Mesh
from replicate.regional.model import RegionalModel

WEIGHTS, REST = "weights", "rest"  # the graph's output; the shape of what a method is off at rest
REST_MM = 1e-4  # less than that is rounding
USUAL_POSES = 200  # half of them within the limits of controls: there the largest weight is made 1
AXES = "xyz"
EACH = 12  # shapes of a rigid segment


@dataclass(frozen=True)
class Shape:
    """How a weight of 1 moves some vertices; the others stay. vertices: ascending, each once. offsets: mm."""

    name: str
    vertices: Int[np.ndarray, " k"]
    offsets: Float32[np.ndarray, "k 3"]


@dataclass(frozen=True)
class ShapedFace:
    """A face's neutral mesh and its shapes, and what gives their weights.

    mesh: the neutral mesh, mm, and its segments.
    shapes: in the order of the weights: those of networks, `rest` where there is one, twelve of each rigid segment.
    at_rest: (s,), the weights at the default of every control.
    """

    mesh: Mesh
    shapes: tuple[Shape, ...]
    at_rest: Float32[np.ndarray, " s"]
    _given: _Weights

    @property
    def names(self) -> list[str]:
        """The shapes' names, all of them different."""
        return [shape.name for shape in self.shapes]

    @property
    def has_halves(self) -> bool:
        """Whether 16 bits hold the networks' weights, as they hold ours, so that the ONNX model stores no more."""
        networks = [part.network for part in self._given.split.parts if part.network is not None]
        numbers = [number for network in networks for number in network.parameters()]
        return bool(numbers) and all(torch.equal(number, number.half().float()) for number in numbers)

    def weights(self, params: Float[np.ndarray, "b m"]) -> Float32[np.ndarray, "b s"]:
        """Return the shapes' weights for raw rig parameters; the ONNX model gives the same."""
        return self._given(params)

    def posed(self, weights: Float[np.ndarray, "b s"]) -> Float32[np.ndarray, "b n 3"]:
        """Return the vertices, mm, that weights make of the neutral mesh."""
        out, start = np.repeat(self.mesh.neutral[None].astype(np.float32), len(weights), axis=0), 0
        for vertices, offsets in self._groups:
            share = np.asarray(weights[:, start : start + len(offsets)], np.float32)
            out[:, vertices] += (share @ offsets).reshape(len(share), -1, 3)
            start += len(offsets)
        return out

    @cached_property
    def _groups(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """The vertices (v,) and the offsets (k, 3v) of shapes that follow each other and move the same vertices."""
        pairs = ((vertices, np.stack([each.offsets for each in alike])) for vertices, alike in together(self.shapes))
        return [(vertices, offsets.reshape(len(offsets), -1)) for vertices, offsets in pairs]


def together(shapes: Sequence[Shape]) -> Iterator[tuple[np.ndarray, list[Shape]]]:
    """Yield the vertices of shapes that follow each other and move the same ones, and these shapes."""
    for _, group in groupby(shapes, key=lambda shape: shape.vertices.tobytes()):
        alike = list(group)
        yield alike[0].vertices, alike


def shaped_face(model: object, mesh: Mesh, attachments: Attachments | None, controls: Sequence[Control]) -> ShapedFace:
    """Return a method's model as shapes.

    Weights of networks and of rigid segments are within ±1 or so where all controls are within their limits.

    mesh: the neutral mesh, mm, and its segments
    attachments: what places the rigid segments; None for a method without that step
    controls: the rig's, in the order of the parameters

    Raises InputError for a model whose last step is no product with shapes.
    """
    split = _split(model, [control.name for control in controls])
    is_rigid = np.isin(mesh.segment, [] if attachments is None else attachments.segment)
    default = np.array([[control.default for control in controls]], np.float32)
    usual = drawn_poses(controls, USUAL_POSES, np.random.default_rng(0))[: USUAL_POSES // 2]

    # the networks' shapes: what moves at rest is taken out of the weights, and becomes a shape
    raw, rest = [shape for part in split.parts for shape in part.shapes], split.outputs(default)[0]
    keep = np.concatenate([np.full(len(part.shapes), part.network is None) for part in split.parts])
    unit = _largest(split.outputs(usual) - rest, keep)
    constant, shapes = split.constant.copy(), []
    for shape, weight, size in zip(raw, rest, unit, strict=True):
        constant[shape.vertices] += weight.astype(np.float64) * shape.offsets
        own = ~is_rigid[shape.vertices]
        shapes.append(Shape(shape.name, shape.vertices[own], shape.offsets[own] * size))
    constant[is_rigid] = 0.0
    has_rest = np.linalg.norm(constant, axis=1).max() > REST_MM
    if has_rest:
        moved = np.flatnonzero(constant.any(axis=1))
        shapes.append(Shape(REST, moved, constant[moved].astype(np.float32)))

    # the rigid segments' shapes
    given = _Weights(split, rest, unit, bool(has_rest), None)
    if attachments is not None and len(attachments.segment):
        plain = _rigid_step(mesh, attachments, shapes)
        unit_of_rigid = _largest(_rigid_weights(plain, given(usual)))
        rigid = replace(plain, unit=unit_of_rigid)
        given, shapes = replace(given, rigid=rigid), [*shapes, *_rigid_shapes(mesh, attachments, rigid)]
    return ShapedFace(mesh, tuple(shapes), given(default)[0], given)


def _largest(weights: Float32[np.ndarray, "b k"], keep: np.ndarray | bool = False) -> Float32[np.ndarray, " k"]:
    """Return the largest size of each weight; 1 for those that are always 0, and for those to `keep`."""
    largest = np.abs(weights).max(axis=0, initial=0.0)
    return np.where(keep | (largest == 0), 1.0, largest).astype(np.float32)


def weights_model(face: ShapedFace, about: Mapping[str, str] | None = None, words: str = "") -> onnx.ModelProto:
    """Return an ONNX model: `parameters` (poses, m) float32 → `weights` (poses, s) float32, in the order of the shapes.

    about: metadata. words: what the model is, in a sentence. Raises InputError as `onnx_functions.recorded` does.
    """
    graph, given = OnnxGraph(face.has_halves), face._given
    split, count = given.split, len(given.split.scale)
    scaled = graph.node("Div", PARAMETERS, graph.constant(split.scale))
    raw = []
    for part in split.parts:
        source = PARAMETERS if part.network is None else scaled
        inputs = source if np.array_equal(part.seen, np.arange(count)) else graph.gather(source, part.seen, 1)
        raw.append(inputs if part.network is None else recorded(part.network, graph, inputs, len(part.seen)))
    found = raw[0] if len(raw) == 1 else graph.node("Concat", *raw, axis=1)
    found = graph.node("Div", graph.node("Sub", found, graph.constant(given.rest)), graph.constant(given.unit))
    if given.has_rest:
        nothing = graph.node("MatMul", PARAMETERS, graph.constant(np.zeros((count, 1))))
        found = graph.node("Concat", found, graph.node("Add", nothing, graph.constant(np.ones((1, 1)))), axis=1)
    if given.rigid is not None:
        found = graph.node("Concat", found, _add_rigid_weights(graph, given.rigid, found), axis=1)
    source, target = (PARAMETERS, [POSES, count]), (WEIGHTS, [POSES, len(face.shapes)])
    return graph.model(source, found, target, dict(about or {}), words)


def found_weights(model: onnx.ModelProto, params: Float32[np.ndarray, "b m"]) -> Float32[np.ndarray, "b s"]:
    """Return the weights that onnxruntime gives for a model, on the CPU and one thread."""
    return weights_by_onnx(model.SerializeToString())(params)


def weights_by_onnx(written: bytes) -> Callable[[np.ndarray], np.ndarray]:
    """Return parameters (b, m) float32 → weights (b, s) float32 of an ONNX file, by onnxruntime on one thread."""
    network = session(written)
    return lambda params: network.run([WEIGHTS], {PARAMETERS: params})[0]


# What gives the weights: networks, and the rigid step.


@dataclass(frozen=True)
class _Part:
    """A network, (b, j) scaled parameters → (b, k), and the shapes that its outputs weigh.

    network: None where the outputs are the raw parameters themselves. seen: (j,), which parameters it sees.
    """

    network: nn.Module | None
    seen: Int[np.ndarray, " j"]
    shapes: Sequence[Shape]


@dataclass(frozen=True)
class _Split:
    """A model taken apart: its offsets are a constant and the weighted sum of its parts' shapes.

    scale: (m,), what parameters are divided by. constant: (n, 3), mm.
    """

    scale: Float32[np.ndarray, " m"]
    parts: Sequence[_Part]
    constant: Float64[np.ndarray, "n 3"]

    def outputs(self, params: Float[np.ndarray, "b m"]) -> Float32[np.ndarray, "b k"]:
        """Return what the parts give for raw parameters."""
        raw = np.asarray(params, np.float32)
        scaled = torch.from_numpy(raw / self.scale)
        with torch.no_grad():
            found = [
                raw[:, part.seen] if part.network is None else part.network(scaled[:, part.seen]).numpy()
                for part in self.parts
            ]
        return np.concatenate(found, axis=1)


@dataclass(frozen=True)
class _RigidStep:
    """What the other shapes' weights tell of r rigid segments.

    rest: the carriers at rest, mm.
    moving: (s,), which of the other shapes move them.
    shapes: (s, 3rc), how these do, mm.
    unit: (12r,), what the numbers of all segments are divided by.
    """

    rest: Float64[np.ndarray, "r c 3"]
    moving: Int[np.ndarray, " s"]
    shapes: Float32[np.ndarray, "s d"]
    unit: Float32[np.ndarray, " u"]

    @property
    def centre(self) -> Float64[np.ndarray, "r 1 3"]:
        return self.rest.mean(axis=1, keepdims=True)


@dataclass(frozen=True)
class _Weights:
    """Raw parameters (b, m) → the weights of all shapes (b, s).

    split: the networks. rest, unit: (k,), their outputs at rest, and what the outputs less these are divided by.
    has_rest: whether `rest` is a shape. rigid: None where nothing is rigid.
    """

    split: _Split
    rest: Float32[np.ndarray, " k"]
    unit: Float32[np.ndarray, " k"]
    has_rest: bool
    rigid: _RigidStep | None

    def __call__(self, params: Float[np.ndarray, "b m"]) -> Float32[np.ndarray, "b s"]:
        found = (self.split.outputs(params) - self.rest) / self.unit
        if self.has_rest:
            found = np.concatenate([found, np.ones((len(found), 1), np.float32)], axis=1)
        return found if self.rigid is None else np.concatenate([found, _rigid_weights(self.rigid, found)], axis=1)


def _rigid_step(mesh: Mesh, attachments: Attachments, shapes: Sequence[Shape]) -> _RigidStep:
    carriers, dense = attachments.vertex.ravel(), np.zeros((len(mesh.neutral), 3), np.float32)
    rows = np.empty((len(shapes), 3 * len(carriers)), np.float32)
    for row, shape in zip(rows, shapes, strict=True):
        dense[shape.vertices] = shape.offsets
        row[:] = dense[carriers].ravel()
        dense[shape.vertices] = 0.0
    moving, unit = np.flatnonzero(rows.any(axis=1)), np.ones(EACH * len(attachments.segment), np.float32)
    return _RigidStep(mesh.neutral[attachments.vertex].astype(np.float64), moving, rows[moving], unit)


def _rigid_weights(rigid: _RigidStep, weights: Float32[np.ndarray, "b s"]) -> Float32[np.ndarray, "b u"]:
    posed = rigid.rest + (weights[:, rigid.moving] @ rigid.shapes).reshape(len(weights), *rigid.rest.shape)
    turn = align(rigid.rest, posed)[0] - np.eye(3)
    shift = posed.mean(axis=2) - rigid.centre[:, 0]
    both = np.concatenate([turn.reshape(*turn.shape[:2], -1), shift], axis=2)
    return (both.reshape(len(weights), -1) / rigid.unit).astype(np.float32)


def _add_rigid_weights(graph: OnnxGraph, rigid: _RigidStep, weights: str) -> str:
    """Return the weights of all rigid segments' shapes (b, 12r)."""
    count, each = rigid.rest.shape[:2]
    weights = graph.gather(weights, rigid.moving, 1)
    carriers = graph.node("Gemm", weights, graph.constant(rigid.shapes), graph.constant(rigid.rest.ravel()))
    posed = graph.reshape(carriers, [0, count, each, 3])
    centre = graph.reduce("ReduceMean", posed, 2)  # (b, r, 1, 3)
    rotation = add_rotations(graph, rigid.rest - rigid.centre, graph.node("Sub", posed, centre))
    turn = graph.reshape(graph.node("Sub", rotation, graph.constant(np.eye(3))), [0, count, 9])
    shift = graph.reshape(graph.node("Sub", centre, graph.constant(rigid.centre)), [0, count, 3])
    both = graph.reshape(graph.node("Concat", turn, shift, axis=2), [0, EACH * count])
    return graph.node("Div", both, graph.constant(rigid.unit))


def _rigid_shapes(mesh: Mesh, attachments: Attachments, rigid: _RigidStep) -> Iterator[Shape]:
    for k, centre, units in zip(attachments.segment, rigid.centre, rigid.unit.reshape(-1, EACH), strict=True):
        vertices, name = np.flatnonzero(mesh.segment == k), mesh.segment_names[k]
        arms = np.column_stack([mesh.neutral[vertices] - centre, np.ones(len(vertices))])
        ways = [*product(range(3), range(3)), *((3, j) for j in range(3))]  # what is weighed, and along which axis
        for (i, j), unit in zip(ways, units, strict=True):
            offsets = np.zeros((len(vertices), 3), np.float32)
            offsets[:, j] = arms[:, i] * unit
            way = f"shift_{AXES[j]}" if i == 3 else f"turn_{AXES[i]}{AXES[j]}"
            yield Shape(f"{name}_{way}", vertices, offsets)


# Models taken apart: weights on the one side, shapes on the other.


@singledispatch
def _split(model: object, controls: Sequence[str]) -> _Split:
    raise InputError(f"{type(model).__name__} has no shapes: expected a model whose last step is a product with some")


@_split.register
def _(model: RegionalModel, controls: Sequence[str]) -> _Split:
    constant, parts, bases = np.zeros((model.vertex_count, 3)), [], enumerate(model.bases)
    for network, seen in zip(model.network.networks, model.network.seen, strict=True):
        shapes = []
        while len(shapes) < network.output.out_features:
            k, basis = next(bases)
            vertices, components = basis.vertices.numpy(), basis.components().numpy() * np.float32(model.length)
            constant[vertices] += basis.means().numpy()
            shapes += _named([f"region_{k:02d}_{i:02d}" for i in range(len(components))], vertices, components)
        parts.append(_Part(network, seen.numpy(), shapes))
    return _Split(model.scale.numpy(), parts, constant)


@_split.register
def _(model: SegmentedModel, controls: Sequence[str]) -> _Split:
    constant, parts, scale = np.zeros((model.vertex_count, 3)), [], model.scale.cpu().numpy()
    for network, segment, length in zip(model.networks, model.segments, model.lengths, strict=True):
        inner, rows, bias = _last_step(network)
        rows, bias = (part.detach().cpu().numpy() * np.float32(length) for part in (rows, bias))
        names = [f"shape_{i:03d}" for i in range(len(rows))]
        if inner is None:
            rows /= scale[segment.parameters, None]
            names = [controls[int(i)] for i in segment.parameters]
        if len(model.segments) > 1:
            names = [f"{segment.name}_{name}" for name in names]
        constant[segment.vertices] += bias.reshape(-1, 3)
        parts.append(_Part(inner, segment.parameters, _named(names, segment.vertices, rows)))
    return _Split(scale, parts, constant)


def _named(names: Sequence[str], vertices: np.ndarray, rows: Float32[np.ndarray, "k d"]) -> list[Shape]:
    """Return rows (k, 3v) as shapes whose vertices ascend."""
    order = np.argsort(vertices)
    offsets = rows.reshape(len(rows), -1, 3)[:, order]
    return [Shape(name, vertices[order].astype(np.int64), each) for name, each in zip(names, offsets, strict=True)]


@singledispatch
def _last_step(network: nn.Module) -> tuple[nn.Module | None, torch.Tensor, torch.Tensor]:
    """Return what comes before a network's last step, the shapes of that step (k, 3v), and its constant (3v,).

    Networks to the coefficients of a basis are told by it, of whichever class they are.
    """
    basis, mean = (getattr(network, name, None) for name in ("basis", "mean"))
    if isinstance(basis, torch.Tensor) and isinstance(mean, torch.Tensor):
        return _Coefficients(network, len(basis)), basis, mean
    raise InputError(
        f"{type(network).__name__} has no shapes: expected a network whose last step is a product with some"
    )


@_last_step.register
def _(network: Line) -> tuple[nn.Module | None, torch.Tensor, torch.Tensor]:
    return None, network.weight, network.bias


@_last_step.register
def _(network: DenseNetwork) -> tuple[nn.Module | None, torch.Tensor, torch.Tensor]:
    if network.slopes[-1] != 1.0:
        raise InputError("a dense network has no shapes, unless its last hidden layer is linear")
    return _Hidden(network), network.output.weight.T, network.output.bias


class _Hidden(nn.Module):
    """The hidden layers of a dense network."""

    def __init__(self, network: DenseNetwork):
        super().__init__()
        self.network = network

    def forward(self, params: Float[torch.Tensor, "b j"]) -> Float[torch.Tensor, "b c"]:
        for layer, slope in zip(self.network.hidden, self.network.slopes, strict=True):
            params = layer(params)
            params = params if slope == 1.0 else functional.leaky_relu(params, slope)
        return params


class _Coefficients(nn.Module):
    """The coefficients that a network has for its basis: what it gives with unit vectors in place of the basis."""

    def __init__(self, network: nn.Module, count: int):
        super().__init__()
        unit, self.network = torch.eye(count, -(-count // 3) * 3), deepcopy(network)
        self.network.basis, self.network.mean = unit, torch.zeros(unit.shape[1])
        self.register_buffer("own", torch.arange(count), persistent=False)

    def forward(self, params: Float[torch.Tensor, "b j"]) -> Float[torch.Tensor, "b c"]:
        return self.network(params).flatten(1).index_select(1, self.own)


# Shapes as morph targets of a GLB: sparse accessors, since most shapes move few vertices.

FLOAT, UNSIGNED_SHORT, UNSIGNED_INT = 5126, 5123, 5125  # glTF's numbers for types
MM_PER_M = 1000.0
SEGMENT = "_SEGMENT"  # a vertex attribute: the index of each vertex's segment


def add_targets(face: ShapedFace, buffers: MutableMapping, tree: dict) -> None:
    """Give the only mesh of a glTF tree the shapes as morph targets, and each vertex the number of its segment.

    face: the shapes. Their weights in the file are those at rest.
    buffers, tree: as trimesh hands them to `buffer_postprocessor`, before it joins them.
    """
    count = len(face.mesh.neutral)
    small = count <= np.iinfo(np.uint16).max
    indices, offsets, places, starts = bytearray(), bytearray(), [], []
    for vertices, alike in together(face.shapes):
        start = len(indices)
        indices += vertices.astype("<u2" if small else "<u4").tobytes()
        for shape in alike:
            places.append(start)
            starts.append(len(offsets))
            offsets += (shape.offsets / np.float32(MM_PER_M)).astype("<f4").tobytes()
    indices += bytes(-len(indices) % 4)  # whole words, so that the next buffer is aligned
    of_indices, of_offsets = len(buffers), len(buffers) + 1
    buffers["shape_vertices"], buffers["shape_offsets"] = bytes(indices), bytes(offsets)
    targets = []
    for shape, place, start in zip(face.shapes, places, starts, strict=True):
        metres = shape.offsets / np.float32(MM_PER_M)
        still = np.zeros((int(len(metres) < count), 3), np.float32)
        every = np.concatenate([metres, still])
        accessor = {"componentType": FLOAT, "count": count, "type": "VEC3"}
        accessor |= {"min": every.min(0).tolist(), "max": every.max(0).tolist()}
        if len(metres):
            kind = UNSIGNED_SHORT if small else UNSIGNED_INT
            accessor["sparse"] = {
                "count": len(metres),
                "indices": {"bufferView": of_indices, "byteOffset": place, "componentType": kind},
                "values": {"bufferView": of_offsets, "byteOffset": start},
            }
        targets.append({"POSITION": _added(tree, f"shape {shape.name}", accessor)})

    segment = face.mesh.segment.astype("<f4")
    buffers["segments"] = segment.tobytes()
    accessor = {"bufferView": len(buffers) - 1, "byteOffset": 0, "componentType": FLOAT, "count": count}
    accessor |= {"type": "SCALAR", "min": [float(segment.min())], "max": [float(segment.max())]}
    of_segments = _added(tree, SEGMENT, accessor)
    (mesh,) = tree["meshes"]
    for primitive in mesh["primitives"]:
        primitive["targets"] = targets
        primitive["attributes"][SEGMENT] = of_segments
    mesh["weights"] = face.at_rest.tolist()
    named = {"targetNames": face.names, "segmentNames": [*face.mesh.segment_names]}
    mesh["extras"] = mesh.get("extras", {}) | named


def _added(tree: dict, key: str, accessor: dict) -> int:
    tree["accessors"][key] = accessor
    return len(tree["accessors"]) - 1
