"""A trained model evaluated on a GPU by torch, with the compiled rigid step on the CPU, as Table 3 has it (§5.2).

A pose is little work for a GPU, and each of its operations is started by the CPU. So there are two ways: each operation
started on its own, as the paper's networks were evaluated, and all of them recorded once as a CUDA graph, which is
started as a whole. Convolutions are in float32: torch's usual ones on a GPU keep ten bits of a factor (TF32).
"""

from collections.abc import Callable
from copy import deepcopy
from functools import singledispatch

import numpy as np
import torch
from jaxtyping import Float
from torch.backends import cudnn

from replicate.approximation.model import SegmentedModel
from replicate.approximation.refinement import RefinedModel
from replicate.approximation.rigid import Attachments
from replicate.geometry.mesh import Mesh
from replicate.inference.fast_evaluation import Evaluate
from replicate.inference.rigid_step import place_rigid_segments, plan_rigid_step
from replicate.regional.model import RegionalModel

WARM_UP = 3  # evaluations before a recording, in which libraries choose their functions

Offsets = Callable[[torch.Tensor], torch.Tensor]  # raw parameters (b, m) → offsets (b, n, 3) mm, on one device


def gpu_evaluation(model: object, mesh: Mesh, attachments: Attachments, device: str = "cuda") -> Evaluate | None:
    """Return parameters (b, m) → vertices (b, n, 3) mm by torch on a device; None for an unknown kind of model."""
    vertices, rigid = _vertices(model, mesh, device), plan_rigid_step(mesh, attachments)
    if vertices is None:
        return None

    def evaluate(params: Float[np.ndarray, "b m"]) -> Float[np.ndarray, "b n 3"]:
        with torch.no_grad(), cudnn.flags(enabled=True, allow_tf32=False):
            out = vertices(torch.from_numpy(np.ascontiguousarray(params, np.float32)).to(device)).cpu().numpy()
        for pose in out:
            place_rigid_segments(rigid, pose)
        return out

    return evaluate


def graph_evaluation(model: object, mesh: Mesh, attachments: Attachments) -> Evaluate | None:
    """Return parameters (1, m) → vertices (1, n, 3) mm by a CUDA graph; None for an unknown kind of model."""
    vertices = _vertices(model, mesh, "cuda")
    if vertices is None:
        return None
    recording, rigid = _Recording(vertices, _parameter_count(model)), plan_rigid_step(mesh, attachments)

    def evaluate(params: Float[np.ndarray, "1 m"]) -> Float[np.ndarray, "1 n 3"]:
        out = recording.play(params)
        place_rigid_segments(rigid, out[0])
        return out

    return evaluate


class _Recording:
    """What a function of tensors on the GPU does with one pose, recorded to be repeated.

    It holds the function too, since the recording reads the weights where they lie in the GPU's memory.
    """

    def __init__(self, function: Offsets, count: int):
        """Record a function of (1, count) tensors."""
        self._function, self._graph = function, torch.cuda.CUDAGraph()
        self._params = torch.zeros(1, count, device="cuda")
        with torch.no_grad(), cudnn.flags(enabled=True, allow_tf32=False):
            aside = torch.cuda.Stream()
            aside.wait_stream(torch.cuda.current_stream())
            with torch.cuda.stream(aside):
                for _ in range(WARM_UP):
                    function(self._params)
            torch.cuda.current_stream().wait_stream(aside)
            with torch.cuda.graph(self._graph):
                self._found = function(self._params)
        self._given = torch.zeros(self._params.shape, pin_memory=True)
        self._taken = torch.zeros(self._found.shape, pin_memory=True)

    def play(self, params: Float[np.ndarray, "1 m"]) -> Float[np.ndarray, "1 n 3"]:
        """Return the function's result for a pose."""
        self._given.numpy()[:] = params
        self._params.copy_(self._given, non_blocking=True)
        self._graph.replay()
        self._taken.copy_(self._found, non_blocking=True)
        torch.cuda.current_stream().synchronize()
        return self._taken.numpy().copy()


def _parameter_count(model: object) -> int:
    """Return how many rig parameters a model takes."""
    return len((model.coarse if isinstance(model, RefinedModel) else model).scale)


def _vertices(model: object, mesh: Mesh, device: str) -> Offsets | None:
    """Return raw parameters → vertices, rigid segments at rest; None for an unknown kind of model."""
    offsets = offsets_on(model, device)
    if offsets is None:
        return None
    neutral = torch.from_numpy(np.array(mesh.neutral, np.float32)).to(device)
    return lambda params: neutral + offsets(params)


@singledispatch
def offsets_on(model: object, device: str) -> Offsets | None:
    """Return a model's `offsets` as a function of tensors on a device; None for an unknown kind of model."""
    return None


@offsets_on.register
def _(model: SegmentedModel, device: str) -> Offsets:
    copy, place = deepcopy(model).to(device), torch.from_numpy(model.vertices).long().to(device)

    def offsets(params: Float[torch.Tensor, "b m"]) -> Float[torch.Tensor, "b n 3"]:
        return params.new_zeros(len(params), copy.vertex_count, 3).index_copy_(1, place, copy(params))

    return offsets


@offsets_on.register
def _(model: RefinedModel, device: str) -> Offsets:
    coarse, residual = offsets_on(model.coarse, device), offsets_on(model.residual, device)
    return lambda params: coarse(params) + residual(params)


@offsets_on.register
def _(model: RegionalModel, device: str) -> Offsets:
    network, scale = deepcopy(model.network).to(device), model.scale.to(device)
    bases = [(basis.means().flatten().to(device), basis.components().to(device)) for basis in model.bases]
    counts = [len(components) for _, components in bases]
    places = [torch.from_numpy(model.vertices[: len(layer)]).to(device) for layer in model.layers]
    layers = [torch.from_numpy(layer).to(device) for layer in model.layers]

    def offsets(params: Float[torch.Tensor, "b m"]) -> Float[torch.Tensor, "b n 3"]:
        shares = (network(params / scale) * model.length).split(counts, dim=1)
        parts = [torch.addmm(mean, share, components) for (mean, components), share in zip(bases, shares, strict=True)]
        rows = torch.cat(parts, dim=1).unflatten(1, (-1, 3))
        out = params.new_zeros(len(params), model.vertex_count, 3)
        for place, layer in zip(places, layers, strict=True):
            out.index_add_(1, place, rows[:, layer])
        return out

    return offsets
