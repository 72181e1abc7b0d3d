"""Measure the head that a recipe or a model gives, and refuse it in one sentence if it is not a face.

Every number of a recipe is within its range before anything is built. Whether they make a face together shows only in
the finished head. The bounds are far from all of our characters (in brackets: the extremes among tiny, teen, woman,
toon, dragon and ICT-FaceKit).
"""

from dataclasses import fields
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from data_recipes.recipe.character import Recipe
from data_recipes.recipe.facekit import FaceKitRecipe
from data_recipes.rig import Rig
from replicate.base.exceptions import InputError
from replicate.geometry.rays import ray_hits

SIZE_MM = (100.0, 450.0)  # width, height and depth [176 to 338]
OUT_MM = 40.0  # from the skin out to a point of the skull, nose, eyes or ears, at most [0]
TEETH_OUT_MM = 5.0  # from the skin out to a tooth, at most [0]
TEETH_AWAY_MM = 40.0  # from the upper lip to the nearest tooth, at most [5 to 11]
OPEN_MM = 1.0  # between upper and lower lid at rest, at least [8 to 18]
BLINK_GAP = 0.3  # of that gap when the eye blinks, at most [0.003 to 0.07]
NOSE_MM = 120.0  # from the lips forward to the tip of the nose, at most [6 to 28]
SKIN = ("face", "cranium", "head")
UPWARDS = ("chin", "lip_upper_mid", "nose_tip", "eye_outer_left")
BLINKS = {"left": ("blink_left", "eyeBlink_L"), "right": ("blink_right", "eyeBlink_R")}
POINTS = {  # of a recipe's primitives: far from the head they would have no effect
    "skull": (
        *("cranium", "forehead", "face", "jaw_ramus", "jaw_angle", "chin", "chin_corner", "cheekbone", "cheek"),
        *("muzzle", "brow_inner", "brow_outer", "jaw_pivot"),
    ),
    "nose": ("root", "tip", "sidewall", "columella", "wing"),
    "eyes": ("centre",),
    "ears": ("centre",),
}


def check_face(rig: Rig, recipe: Recipe | FaceKitRecipe) -> Rig:
    """Return the rig if it is a face. Raises InputError, naming what is wrong and the place in the recipe."""
    x = rig.mesh.neutral.astype(float)
    marks = dict(zip(rig.landmark_names, rig.landmarks.tolist(), strict=True))
    _check_size(x)
    _check_points(rig, recipe)
    _check_landmarks(x, marks)
    _check_teeth(rig, x, marks)
    _check_lids(rig, x, marks)
    return rig


def _check_size(x: Float[np.ndarray, "n 3"]) -> None:
    for size, direction in zip(np.ptp(x, axis=0), ("wide", "high", "deep"), strict=True):
        requirement = f"{SIZE_MM[0]:g} to {SIZE_MM[1]:g} mm"
        _hold(SIZE_MM[0] <= size <= SIZE_MM[1], "skull", f"it is {size:.0f} mm {direction}", requirement)


def _check_points(rig: Rig, recipe: Recipe | FaceKitRecipe) -> None:
    sections = {field.name for field in fields(recipe)}
    names = [(section, point) for section, points in POINTS.items() if section in sections for point in points]
    if not names:
        return
    out = _outside(rig, np.array([getattr(getattr(recipe, section), name) for section, name in names]))
    for (section, name), distance in zip(names, out, strict=True):
        finding = f"this point lies {distance:.0f} mm outside the skin"
        _hold(distance <= OUT_MM, f"{section}.{name}", finding, f"at most {OUT_MM:g} mm")


def _check_landmarks(x: Float[np.ndarray, "n 3"], marks: dict[str, int]) -> None:
    first: dict[int, str] = {}
    for name, vertex in marks.items():
        other = first.setdefault(vertex, name)
        _hold(other == name, "template", f"the landmarks {other} and {name} are the same vertex", "two")
    for low, high in pairwise(UPWARDS):
        if low in marks and high in marks:
            rise = x[marks[high], 1] - x[marks[low], 1]
            _hold(rise > 0, "skull", f"the landmark {high} lies {-rise:.0f} mm below {low}", "it above")
    if {"nose_tip", "lip_upper_mid"} <= set(marks):
        ahead = x[marks["nose_tip"], 2] - x[marks["lip_upper_mid"], 2]
        finding = f"the tip of the nose is {ahead:.0f} mm in front of the lips"
        _hold(abs(ahead) <= NOSE_MM, "nose", finding, f"at most {NOSE_MM:g} mm")


def _check_teeth(rig: Rig, x: Float[np.ndarray, "n 3"], marks: dict[str, int]) -> None:
    teeth = x[_members(rig, ("tooth", "teeth"))]
    if not len(teeth) or "lip_upper_mid" not in marks:
        return
    out = _outside(rig, teeth).max()
    _hold(out <= TEETH_OUT_MM, "teeth", f"a tooth stands {out:.0f} mm out of the skin", f"at most {TEETH_OUT_MM:g} mm")
    away = np.linalg.norm(teeth - x[marks["lip_upper_mid"]], axis=1).min()
    finding = f"the nearest tooth is {away:.0f} mm from the upper lip"
    _hold(away <= TEETH_AWAY_MM, "teeth", finding, f"at most {TEETH_AWAY_MM:g} mm")


def _check_lids(rig: Rig, x: Float[np.ndarray, "n 3"], marks: dict[str, int]) -> None:
    columns = {control.name: column for column, control in enumerate(rig.controls)}
    blinks = {side: [columns[name] for name in names if name in columns] for side, names in BLINKS.items()}
    pose = rig.default.copy()
    for at in blinks.values():
        pose[at] = rig.upper[at]
    blink_x = rig(pose)
    for side in BLINKS:
        upper, lower = marks.get(f"lid_upper_{side}"), marks.get(f"lid_lower_{side}")
        if upper is None or lower is None:
            continue
        rest, gap = (float(v[upper, 1] - v[lower, 1]) for v in (x, blink_x))
        _hold(rest >= OPEN_MM, "eyes", f"the {side} lids are {rest:.1f} mm apart at rest", f"at least {OPEN_MM:g} mm")
        finding = f"the {side} lids are still {gap:.1f} of {rest:.1f} mm apart when the eye blinks"
        _hold(not blinks[side] or abs(gap) <= BLINK_GAP * rest, "eyes", finding, f"at most {BLINK_GAP:.0%} of it")


def _outside(rig: Rig, points: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, " k"]:
    """Return how far points lie outside the skin, in mm, along rays from the middle of the head."""
    x = rig.mesh.neutral.astype(float)
    inner = np.zeros(len(x), bool)
    inner[_members(rig, SKIN)] = True
    skin = rig.mesh.faces[inner[rig.mesh.faces].all(axis=1)]
    middle = (x[inner].min(axis=0) + x[inner].max(axis=0)) / 2
    rays = points - middle
    share, _ = ray_hits(np.tile(middle, (len(points), 1)), rays, x[skin])
    return (1 - np.minimum(share, 1.0)) * np.linalg.norm(rays, axis=1)


def _members(rig: Rig, starts: tuple[str, ...]) -> np.ndarray:
    mask = np.array([name.startswith(starts) for name in rig.mesh.segment_names])
    return np.flatnonzero(mask[rig.mesh.segment])


def _hold(rule: bool | np.bool_, where: str, finding: str, requirement: str) -> None:
    """Raise InputError unless a rule holds; where: the section or key of the recipe."""
    if not rule:
        raise InputError(f"{where}: the head is not a face: {finding}; expected {requirement}")
