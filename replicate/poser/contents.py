"""What a page carries of a character: mesh, approximation, rigid step, IK networks and controls."""

import copy
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, singledispatch

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32
from torch import nn

from data_recipes.rig import Rig
from replicate.approximation.cnn import START
from replicate.approximation.model import SegmentedModel
from replicate.approximation.refinement import RefinedModel
from replicate.approximation.rigid import Attachments
from replicate.drawing.characters import colours_by_segment
from replicate.drawing.light import PORTRAIT, plain_lights
from replicate.inference.fast_evaluation import fast_evaluation
from replicate.inverse.control_points import ControlPoints, control_points
from replicate.inverse.ik_network import IkModel
from replicate.poser.pack import Parts, indices
from replicate.regional.model import RegionalModel
from replicate.regional.networks import SLOPE

# What a page carries of an approximation: our regional method's network and bases, or the paper's CNN.

OURS = "our regional method"
Approximation = RegionalModel | SegmentedModel | RefinedModel  # of those by segment, the ones with maps


def halved(network: nn.Module) -> nn.Module:
    """Return a copy of a network with its weights rounded to 16 bits, as a page has them."""
    twin = copy.deepcopy(network)
    with torch.no_grad():
        for weight in twin.parameters():
            weight.copy_(weight.half().float())
    return twin


@singledispatch
def as_on_page(model: Approximation) -> Approximation:
    """Return a model with its weights as a page has them."""
    raise TypeError(f"no page evaluates a {type(model).__name__}")


@as_on_page.register
def _(model: RegionalModel) -> RegionalModel:
    return model  # its weights are stored in 16 bits


@as_on_page.register
def _(model: SegmentedModel) -> SegmentedModel:
    return halved(model)


@as_on_page.register
def _(model: RefinedModel) -> RefinedModel:
    return RefinedModel(as_on_page(model.coarse), as_on_page(model.residual))


@singledispatch
def approximation_contents(model: Approximation) -> Parts:
    """Return what a page needs to evaluate a model that `as_on_page` returned."""
    raise TypeError(f"no page evaluates a {type(model).__name__}")


@approximation_contents.register
def _(model: RegionalModel) -> Parts:
    arrays, networks = {"regional.scale": model.scale.numpy()}, model.network.networks
    for k, (network, seen) in enumerate(zip(networks, model.network.seen, strict=True)):
        arrays |= layers(f"regional.{k}", [*network.layers, network.output])
        arrays[f"regional.{k}.seen"] = indices(seen.numpy(), len(model.scale))
        arrays |= {f"regional.{k}.{name}": half(getattr(network, name)) for name in ("lowest", "highest")}
        for i, ends in enumerate(network.limits):
            arrays |= {f"regional.{k}.{i}.{name}": half(end) for name, end in zip(("least", "most"), ends, strict=True)}
        if network.line is not None:
            arrays[f"regional.{k}.line"] = half(network.line.weight)
    for k, basis in enumerate(model.bases):
        arrays[f"basis.{k}.vertices"] = indices(basis.vertices.numpy(), model.vertex_count)
        for name in ("weights", "mean", "fine", "rough", "steps"):
            arrays[f"basis.{k}.{name}"] = getattr(basis, name).numpy()
    shape = {"layers": len(networks[0].layers) + 1, "gated": networks[0].is_gated, "slope": SLOPE}
    counts = {"networks": len(networks), "regions": len(model.bases)}
    words = {**shape, **counts, "length_mm": model.length}
    return {"approximation": OURS, "regional": words}, arrays


@approximation_contents.register
def _(model: SegmentedModel) -> Parts:
    return _maps("the coarse CNN of the paper", [model])


@approximation_contents.register
def _(model: RefinedModel) -> Parts:
    return _maps("the refined CNN of the paper", [model.coarse, model.residual])


def _maps(title: str, models: list[SegmentedModel]) -> Parts:
    """Return the networks of some models with maps, whose offsets are added."""
    words, arrays = [], {"maps.scale": models[0].scale.numpy()}
    for model in models:
        for network, segment, length in zip(model.networks, model.segments, model.lengths, strict=True):
            prefix = f"maps.{len(words)}"
            convolutions = [*network.upsampled, network.last]
            arrays |= layers(f"{prefix}.dense", network.dense) | layers(f"{prefix}.convolution", convolutions)
            arrays |= {
                f"{prefix}.output.weight": half(network.output.weight[:, :, 0, 0]),
                f"{prefix}.output.bias": half(network.output.bias),
                f"{prefix}.uv": np.asarray(segment.uv, np.float32),
                f"{prefix}.vertices": indices(segment.vertices, model.vertex_count),
                f"{prefix}.parameters": indices(segment.parameters, len(model.scale)),
            }
            sizes = {"size": network.map_size, "start": START, "channels": network.last.out_channels}
            depths = {"dense": len(network.dense), "convolutions": len(convolutions)}
            words.append({**sizes, **depths, "slope": network.slope, "length_mm": length})
    return {"approximation": title, "maps": words}, arrays


def layers(prefix: str, modules: "nn.ModuleList | list[nn.Module]") -> dict[str, np.ndarray]:
    """Return weights (outputs, inputs, …) and biases of layers in 16 bits."""
    arrays = {}
    for i, layer in enumerate(modules):
        arrays[f"{prefix}.{i}.weight"] = half(layer.weight)
        arrays[f"{prefix}.{i}.bias"] = half(layer.bias)
    return arrays


def half(weight: torch.Tensor) -> np.ndarray:
    """Return weights as float16."""
    return weight.detach().cpu().numpy().astype(np.float16)


@dataclass(frozen=True)
class PosedFace:
    """A character to pose: its rig, and what stands in for the rig's function.

    rig: for its mesh, names and limits
    model: rig parameters → offsets, with weights as a page has them
    attachments: what places the rigid segments
    ik: control points → rig parameters
    influence: (n, m), which control moves which vertex
    """

    rig: Rig
    model: Approximation
    attachments: Attachments
    ik: IkModel
    influence: Bool[np.ndarray, "n m"]

    @cached_property
    def evaluate(self) -> Callable[[np.ndarray], np.ndarray] | None:
        """Raw rig parameters (1, m) → the whole posed mesh (1, n, 3), mm, as fast as the suite can.

        None for networks without a fast evaluation, such as maps with other channels than the paper's.
        """
        return fast_evaluation(self.model, self.rig.mesh, self.attachments)

    def dragged(
        self, params: Float[np.ndarray, " m"], before: Float[np.ndarray, "c 3"], after: Float[np.ndarray, "c 3"]
    ) -> Float32[np.ndarray, " m"]:
        """Return the rig parameters after control points are dragged from some places (mm) to others.

        They change by as much as the IK networks' answer does, and keep within their limits (D25).
        """
        solved_before, solved_after = self.ik.solve(np.stack([before, after]))
        return np.clip(params + solved_after - solved_before, self.rig.lower, self.rig.upper).astype(np.float32)


def face_contents(face: PosedFace) -> Parts:
    """Return all that a page needs to pose a face, except for the meshes that are only displayed."""
    header, arrays = {}, {}
    for words, values in (
        _mesh(face.rig),
        _controls(face.rig),
        _points(control_points(face.rig, face.influence)),
        approximation_contents(face.model),
        _rigid(face.rig, face.attachments),
        _inverse(face.ik),
    ):
        header |= words
        arrays |= values
    return header, arrays


def _mesh(rig: Rig) -> Parts:
    mesh = rig.mesh
    paint = colours_by_segment(mesh)[mesh.segment] if rig.paint is None else np.asarray(rig.paint, np.uint8)
    lights, ambient = plain_lights(PORTRAIT)
    lights = [[*lamp.direction, lamp.strength, *lamp.colour] for lamp in lights]
    return {"character": rig.name, "lights": lights, "ambient": ambient}, {
        "neutral": mesh.neutral,
        "faces": indices(mesh.faces, len(mesh.neutral)),
        "paint": paint,
    }


def _controls(rig: Rig) -> Parts:
    limits = np.stack([rig.lower, rig.default, rig.upper], axis=1).astype(np.float32)
    controls = [{"name": control.name, "region": control.region} for control in rig.controls]
    return {"controls": controls}, {"limits": limits}


def _points(points: ControlPoints) -> Parts:
    region_of = {i: region.name for region in points.regions for i in region.points.tolist()}
    names = [{"name": name, "region": region_of[i]} for i, name in enumerate(points.names)]
    return {"points": names}, {"points": points.vertices.astype(np.uint32)}


def _rigid(rig: Rig, attachments: Attachments) -> Parts:
    segment, count = rig.mesh.segment, len(rig.mesh.neutral)
    arrays = {}
    for row, k in enumerate(attachments.segment):
        arrays[f"rigid.{row}.members"] = indices(np.flatnonzero(segment == k), count)
        arrays[f"rigid.{row}.carriers"] = indices(attachments.vertex[row], count)
    return {"rigid": len(attachments.segment)}, arrays


def _inverse(ik: IkModel) -> Parts:
    regions = [
        {"name": region.name, "points": region.points.tolist(), "parameters": region.parameters.tolist()}
        for region in ik.regions
    ]
    arrays = {f"inverse.{name}": getattr(ik, name).numpy() for name in ("neutral", "spread", "default", "reach")}
    for j, network in enumerate(ik.networks):
        arrays |= layers(f"inverse.{j}", [*network.hidden, network.output])
    return {"inverse": {"layers": len(ik.widths) + 1, "slope": ik.slope, "axes": ik.axes, "regions": regions}}, arrays
