"""What a page carries of a character: mesh, approximation, rigid step, IK networks and controls."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Float32

from data_recipes.rig import Rig
from replicate.approximation.rigid import Attachments
from replicate.drawing.characters import colours_by_segment
from replicate.drawing.scene import PORTRAIT
from replicate.inference.fast_evaluation import fast_evaluation
from replicate.inverse.control_points import ControlPoints, control_points
from replicate.inverse.ik_network import IkModel
from replicate.poser.approximation_contents import Approximation, approximation_contents, layers
from replicate.poser.pack import Parts, indices


@dataclass(frozen=True)
class PosedFace:
    """A character as it is posed: the rig for its mesh, names and limits, and what stands in for its function.

    model: rig parameters → offsets, with weights as a page has them. attachments: what places the rigid segments. ik:
    control points → rig parameters. influence: which control (m) moves which vertex (n).
    """

    rig: Rig
    model: Approximation
    attachments: Attachments
    ik: IkModel
    influence: Bool[np.ndarray, "n m"]

    @cached_property
    def evaluate(self) -> Callable[[np.ndarray], np.ndarray] | None:
        """Raw rig parameters (1, m) → the whole posed mesh (1, n, 3), mm, as fast as the suite can.

        None for networks that have no fast evaluation, as those with other numbers of channels than the paper's.
        """
        return fast_evaluation(self.model, self.rig.mesh, self.attachments)

    def dragged(
        self, params: Float[np.ndarray, " m"], before: Float[np.ndarray, "c 3"], after: Float[np.ndarray, "c 3"]
    ) -> Float32[np.ndarray, " m"]:
        """Return the rig parameters after control points are dragged from some places (mm) to others.

        They change by as much as the IK networks' answer does, and keep within their limits (D25).
        """
        said = self.ik.solve(np.stack([before, after]))
        return np.clip(params + said[1] - said[0], self.rig.lower, self.rig.upper).astype(np.float32)


def face_contents(face: PosedFace) -> Parts:
    """Return all that a page needs to pose a face, but for the meshes that are there for display alone."""
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
    lights = [[*light.direction, light.strength, *light.colour] for light in PORTRAIT.lights]
    return {"character": rig.name, "lights": lights, "ambient": PORTRAIT.ambient}, {
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
