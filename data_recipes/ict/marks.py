"""The model's 68 landmarks (Multi-PIE) as landmarks and control points of the rig, and the regions of its controls."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from jaxtyping import Int

from data_recipes.controls import Control

# Of both sides and the middle; the model's left is the picture's right.
LANDMARKS = {
    "chin": 8,
    "jaw_right": 5,
    "jaw_left": 11,
    "jaw_corner_right": 3,
    "jaw_corner_left": 13,
    "brow_outer_right": 17,
    "brow_mid_right": 19,
    "brow_inner_right": 21,
    "brow_inner_left": 22,
    "brow_mid_left": 24,
    "brow_outer_left": 26,
    "nasion": 27,
    "nose_tip": 30,
    "nose_wing_right": 31,
    "nose_wing_left": 35,
    "eye_outer_right": 36,
    "lid_upper_right": 37,
    "eye_inner_right": 39,
    "lid_lower_right": 41,
    "eye_inner_left": 42,
    "lid_upper_left": 44,
    "eye_outer_left": 45,
    "lid_lower_left": 46,
    "mouth_corner_right": 48,
    "lip_upper_top": 51,
    "mouth_corner_left": 54,
    "lip_lower_bottom": 57,
    "lip_upper_mid": 62,
    "lip_lower_mid": 66,
}
# What inverse kinematics drags, by the region whose network the points feed.
CONTROL_POINTS = {
    "jaw": {"jaw_right": 5, "chin": 8, "jaw_left": 11},
    "brows": {"brow_outer_right": 17, "brow_inner_right": 21, "brow_inner_left": 22, "brow_outer_left": 26},
    "nose": {"nose_tip": 30, "nose_wing_right": 31, "nose_wing_left": 35},
    "eye_right": {"lid_upper_right": 37, "lid_lower_right": 41},
    "eye_left": {"lid_upper_left": 44, "lid_lower_left": 46},
    "mouth": {
        "mouth_corner_right": 48,
        "lip_upper_right": 50,
        "lip_upper_top": 51,
        "lip_upper_left": 52,
        "mouth_corner_left": 54,
        "lip_lower_left": 56,
        "lip_lower_bottom": 57,
        "lip_lower_right": 58,
    },
}
# First and last landmark of each region of the face.
REGIONS = (
    ((4, 12), "jaw"),
    ((17, 26), "brows"),
    ((28, 35), "nose"),
    ((36, 41), "eye_right"),
    ((42, 47), "eye_left"),
    ((48, 67), "mouth"),
)
# The beginning of a control's name and its region.
CONTROL_REGIONS = (("brow", "brows"), ("cheek", "cheeks"), ("jaw", "jaw"), ("mouth", "mouth"), ("nose", "nose"))


def region_of(control: str) -> str:
    """Return the region of the face that a control belongs to."""
    if control.startswith("eye"):
        return "eye_left" if control.endswith("_L") else "eye_right"
    return next((region for start, region in CONTROL_REGIONS if control.startswith(start)), "head")


def landmarks(marks: Int[np.ndarray, " l"]) -> tuple[tuple[str, ...], Int[np.ndarray, " k"]]:
    """Return the landmarks' names and vertices. marks: the 68 as the mesh's vertices."""
    return tuple(LANDMARKS), marks[list(LANDMARKS.values())].astype(np.int32)


def control_points(marks: Int[np.ndarray, " l"]) -> tuple[tuple[str, ...], Int[np.ndarray, " c"], tuple[str, ...]]:
    """Return names, vertices and regions of what inverse kinematics drags."""
    points = [(name, marks[k], region) for region, members in CONTROL_POINTS.items() for name, k in members.items()]
    names, vertices, regions = zip(*points, strict=True)
    return names, np.array(vertices, np.int32), regions


def face_marks(marks: Int[np.ndarray, " l"]) -> tuple[Int[np.ndarray, " k"], tuple[str, ...]]:
    """Return the vertices that mark the face's regions, each once, and their regions."""
    regions: dict[int, str] = {}
    for (first, last), region in REGIONS:
        for vertex in marks[first : last + 1].tolist():
            regions.setdefault(vertex, region)
    return np.array(list(regions), np.int32), tuple(regions.values())


def model_controls(expressions: Iterable[str]) -> tuple[Control, ...]:
    """Return a control from 0 to 1 for each expression of the model, in their order."""
    return tuple(Control(name, 0.0, 0.0, 1.0, region_of(name)) for name in expressions)
