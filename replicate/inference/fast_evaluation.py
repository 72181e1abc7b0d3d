"""The fast evaluation of all trained models: rig parameters in, the whole posed mesh out, one pose a call."""

from collections.abc import Callable
from functools import singledispatch
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Float32

from replicate.approximation.cnn import MapNetwork
from replicate.approximation.model import SegmentedModel
from replicate.approximation.refinement import RefinedModel
from replicate.approximation.rigid import Attachments
from replicate.baselines.dense import DenseNetwork
from replicate.baselines.line import Line
from replicate.geometry.mesh import Mesh
from replicate.inference.dense_evaluation import FastDense
from replicate.inference.map_evaluation import fast_maps, has_plan
from replicate.inference.products import Work
from replicate.inference.regional_evaluation import FastRegions
from replicate.inference.rigid_step import place_rigid_segments, plan_rigid_step
from replicate.regional.model import RegionalModel

Evaluate = Callable[[np.ndarray], np.ndarray]


@runtime_checkable
class Places(Protocol):
    """The fast evaluation of the vertices that a model moves; rigid segments are left out."""

    def place(self, params: Float32[np.ndarray, " m"], out: Float32[np.ndarray, "n 3"]) -> None:
        """Move the vertices of `out`, the mesh at rest in mm, for raw rig parameters."""

    def work(self, params: Float32[np.ndarray, " m"]) -> Work:
        """Return what a pose, given as raw rig parameters, costs."""


def fast_evaluation(model: object, mesh: Mesh, attachments: Attachments, halves: bool = False) -> Evaluate | None:
    """Return parameters (1, m) → vertices (1, n, 3) float32 mm, the rigid segments placed (§3.4); one thread.

    The result is that of the model and `rigid.attach` to 1e-3 mm. None for a model that has no fast evaluation, or none
    with halves. Two threads need two of these functions, since each has one scratch memory.

    halves: read the weights of dense layers as float16 even where that rounds.
    """
    placing = placing_of(model, mesh, halves)
    if placing is None:
        return None
    rigid = plan_rigid_step(mesh, attachments)

    def evaluate(params: Float[np.ndarray, "1 m"]) -> Float32[np.ndarray, "1 n 3"]:
        out = np.array(mesh.neutral, np.float32)
        placing.place(np.ascontiguousarray(params[0], np.float32), out)
        place_rigid_segments(rigid, out)
        return out[None]

    return evaluate


@singledispatch
def placing_of(model: object, mesh: Mesh, halves: bool = False) -> Places | None:
    """Return the fast evaluation of a model's vertices; None where there is none. halves: as for `fast_evaluation`."""
    return None


@placing_of.register
def _(model: RegionalModel, mesh: Mesh, halves: bool = False) -> Places | None:
    return None if halves else FastRegions(model, mesh.neutral)  # its weights are halves already


@placing_of.register
def _(model: SegmentedModel, mesh: Mesh, halves: bool = False) -> Places | None:
    if _all_are(model, DenseNetwork) or _all_are(model, Line):
        return FastDense(model, mesh.neutral, halves)
    return fast_maps([model], halves) if _has_maps(model) else None


@placing_of.register
def _(model: RefinedModel, mesh: Mesh, halves: bool = False) -> Places | None:
    parts = [model.coarse, model.residual]
    return fast_maps(parts, halves) if all(map(_has_maps, parts)) else None


def _all_are(model: object, kind: type) -> bool:
    return isinstance(model, SegmentedModel) and all(type(network) is kind for network in model.networks)


def _has_maps(model: object) -> bool:
    return _all_are(model, MapNetwork) and all(map(has_plan, model.networks))
