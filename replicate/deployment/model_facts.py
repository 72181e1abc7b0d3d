"""What is said of an exported face and its models: names, units, limits, errors, and what may be done with them."""

import json
from collections.abc import Sequence
from dataclasses import dataclass

from data_recipes.rig import Control
from replicate.approximation.metrics import Errors, summary

PARAMETERS = "raw rig parameters without a unit, in the order of controls; the neutral pose is every control's default"
VERTICES = (
    "millimetres, x to the character's left, y up, z forward, in the order of the vertices in the GLB beside this file"
)
POSES = "any number of poses at once, none too"
OF_SHAPES = (
    "those of the mesh in the GLB beside this file, in its order, plus the sum of its morph targets times the weights, "
    "which come in the order of the targets; metres, x to the character's left, y up, z forward"
)
OUT_OF_RANGE = (
    "Parameters beyond lower and upper are not clamped: the model is evaluated there as it is. It was trained on poses "
    "that leave the limits a little (Eq. 5); the further out, the less it is to be trusted."
)
LICENCE = "MIT licence for the code that wrote this file."
PATENTS = (
    "The method of the paper is patented: DreamWorks holds US 11,348,314 B2 and its family, Pixar's related "
    "FaceBaker is US 11,941,739, and Electronic Arts' inverse rig is US 12,586,281 B2. No right to any is granted. For "
    "research and teaching."
)
HALF = "float16, computed in float32"


@dataclass(frozen=True)
class FaceFacts:
    """The metadata that all models of a character share.

    character: the rig's name
    controls: the rig's, in their order
    segments: names of the mesh's segments
    rigid: names of those that the rigid step places
    made_by: the command that wrote the model
    vertex_count: n
    file_vertices: of each vertex of the file that the face comes from, its place among the model's, −1 for those that
        no model moves; () for faces from no such file
    """

    character: str
    controls: Sequence[Control]
    segments: Sequence[str]
    rigid: Sequence[str]
    made_by: str
    vertex_count: int
    file_vertices: Sequence[int] = ()


def about_face(face: FaceFacts) -> dict[str, object]:
    """Return what all models of a character share, as lists and texts, for a JSON file of its own."""
    controls = [
        {"name": c.name, "region": c.region, "lower": c.lower, "default": c.default, "upper": c.upper}
        for c in face.controls
    ]
    return {
        "character": face.character,
        "poses": POSES,
        "parameters": PARAMETERS,
        "vertices": VERTICES,
        "vertex_count": face.vertex_count,
        **({"file_vertices": [*face.file_vertices]} if len(face.file_vertices) else {}),
        "out_of_range": OUT_OF_RANGE,
        "controls": controls,
        "segments": [*face.segments],
        "rigid_segments": [*face.rigid],
        "licence": LICENCE,
        "patents": PATENTS,
        "made_by": face.made_by,
    }


def about_model(face: FaceFacts, method: str, title: str, errors: Errors, half: bool) -> dict[str, str]:
    """Return the metadata of one model; lists and tables are JSON.

    face: what all models of the character share
    method: the method's name
    title: the method's label
    errors: the method's, on held-out poses
    half: whether weights have 16 bits
    """
    shared = {key: value if isinstance(value, str) else json.dumps(value) for key, value in about_face(face).items()}
    return shared | {
        "method": method,
        "title": title,
        "weights": HALF if half else "float32",
        "held_out_errors": json.dumps(_held_out(errors)),
    }


def in_words(face: FaceFacts, title: str, errors: Errors) -> str:
    """Return what a model is, in a sentence or two."""
    known = _held_out(errors)
    distance, angle = (known[kind]["mean"] for kind in ("distance_mm", "normal_deg"))
    return (
        f"The face {face.character} as the method {title!r} approximates it. On {known['poses']} held-out poses its "
        f"vertices are {distance:.2g} mm off on average, its normals {angle:.2g} degrees."
    )


def _held_out(errors: Errors) -> dict[str, object]:
    """Return a method's errors over all vertices, or faces, of all held-out poses."""
    kinds = {"distance_mm": summary(errors.vertex), "normal_deg": summary(errors.normal)}
    return {"poses": len(errors.pose_mm)} | {
        name: {"mean": of_kind.mean, "p95": of_kind.p95, "max": of_kind.max} for name, of_kind in kinds.items()
    }
