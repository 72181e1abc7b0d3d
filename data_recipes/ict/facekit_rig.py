"""A rig from a folder in ICT-FaceKit's format: its mesh, its expressions as controls, our jaw, wrinkles and acting."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from data_recipes.acting.clip_file import read_clip
from data_recipes.acting.procedural_acting import act_in_arkit_names
from data_recipes.deformers import jaw, wrinkles
from data_recipes.deformers.node_chain import place_of
from data_recipes.deformers.pose_curves import REACH, SHARPNESS, limits
from data_recipes.deformers.surface_operators import adjacency
from data_recipes.face_check import check_face
from data_recipes.face_rig import FaceParts, FaceRig
from data_recipes.ict.facekit_files import FaceKit, read_model
from data_recipes.ict.facekit_nodes import FACEKIT, rest_props, sphere_centre
from data_recipes.ict.facekit_segments import SOFT, Segments, build_charts, split
from data_recipes.ict.fold_regions import build_regions, paint
from data_recipes.ict.jaw_fit import JAW_CONTROLS, fit_jaw
from data_recipes.ict.marks import control_points, face_marks, landmarks, model_controls
from data_recipes.landmark_set import FACE_LANDMARKS
from data_recipes.recipe.facekit import FaceKitRecipe, Reach
from data_recipes.rig import Clip, check_rig
from replicate.base.exceptions import InputError
from replicate.base.schema import naming
from replicate.geometry.mesh import Mesh

EYES_Z_MM = 62.0  # where our heads have their eyes, at y = 0, and the cameras look
NOISE_MM = 0.01  # smaller offsets are rounding in the model's files and not influence
CLOSE, SIDES = "mouthClose", ("L", "R")
LID_CONTROLS = ("eyeSquint_*", "eyeWide_*", "eyeLookUp_*", "eyeLookDown_*")
CLOSING = ("eyeBlink_L", "eyeBlink_R", CLOSE)


def build_facekit_rig(recipe: FaceKitRecipe) -> FaceRig:
    """Return the rig. Raises InputError, naming the folder, the file or the recipe's key, for bad files and values."""
    model = place_model(read_model(recipe.vertices), recipe)
    controls = model_controls(model.offsets)
    clips = [Clip(Path(file).stem, read_clip(Path(file), controls)) for file in recipe.clip_files]
    clips = [Clip(name, values) for name, values in act_in_arkit_names(controls, recipe.acting)] + clips
    segments = split(model, recipe.parts, recipe.file)
    uv, _ = build_charts(model, segments, len(SOFT))
    mesh = Mesh(
        neutral=model.vertices[segments.vertices].astype(np.float32),
        faces=segments.faces.astype(np.int32),
        uv=np.clip(uv, 0, 1).astype(np.float32),
        segment=segments.segment.astype(np.int32),
        segment_names=segments.names,
    )
    marks = _marks(model, segments, recipe.file)
    constants = build_constants(model, segments, marks, recipe)
    colours = paint(mesh.neutral.astype(np.float64), segments, marks)
    teeth = tuple(name for name in segments.names if name not in SOFT)
    face = FaceParts(constants, rest_props(model, recipe.parts), colours, FACEKIT, teeth)
    names, vertices = landmarks(marks)
    point_names, points, regions = control_points(marks)
    places, place_regions = face_marks(marks)
    rig = FaceRig(
        name=recipe.name,
        mesh=mesh,
        controls=controls,
        landmarks=vertices,
        landmark_names=names,
        control_points=points,
        control_point_regions=regions,
        control_point_names=point_names,
        face_marks=places,
        face_mark_regions=place_regions,
        clips=tuple(clips) or None,
        face=face,
    )
    check_rig(rig, tolerance_mm=1e-4)
    with naming(recipe.file):
        check_face(rig, recipe)
    return rig


def place_model(model: FaceKit, recipe: FaceKitRecipe) -> FaceKit:
    """Shift the model so that the middle between its eyes is where our heads have it."""
    balls = [getattr(recipe.parts, f"eyeball_{side}") for side in ("left", "right")]
    centre = np.mean([sphere_centre(model.vertices[a : b + 1]) for a, b in balls], axis=0)
    shift = np.array([0.0, -centre[1], EYES_Z_MM - centre[2]])
    return replace(model, vertices=model.vertices + shift)


def _marks(model: FaceKit, segments: Segments, file: str) -> Int[np.ndarray, " l"]:
    place = np.full(len(model.vertices), -1)
    place[segments.vertices] = np.arange(len(segments.vertices))
    marks = place[model.landmarks]
    if (marks < 0).any():
        vertex = model.landmarks[np.flatnonzero(marks < 0)[0]]
        raise InputError(f"{file}: 'parts': the landmark vertex {vertex} is in none of them, expected one")
    return marks


def facekit_landmarks(recipe: FaceKitRecipe) -> Int[np.ndarray, " l"]:
    """Return the vertices of the rig that are landmarks of performance capture, in the order of `FACE_LANDMARKS`."""
    model = read_model(recipe.vertices)
    marks = _marks(model, split(model, recipe.parts, recipe.file), recipe.file)
    return marks[list(FACE_LANDMARKS.values())].astype(np.int32)


def build_constants(model: FaceKit, segments: Segments, marks: np.ndarray, recipe: FaceKitRecipe) -> dict[str, Any]:
    """Return the constants of every node of `facekit_nodes.NODES`."""
    x = model.vertices[segments.vertices]
    n, m = len(x), len(model.offsets)
    columns = {name: column for column, name in enumerate(model.offsets)}
    teeth = [name for name in segments.names if name not in SOFT]
    lower = segments.members(*segments.lower)
    still = segments.members(*(name for name in teeth if name not in segments.lower))
    graph = adjacency(segments.faces, n)
    shapes = {name: _clean(offset[segments.vertices]) for name, offset in model.offsets.items()}
    fit = fit_jaw(x, {name: shapes[name] for name in JAW_CONTROLS if name in shapes}, lower, still, graph)
    inside = np.concatenate([segments.members("gums_tongue"), lower, still])
    fields = np.stack([fit.offsets.get(name, shapes[name]) for name in columns])
    for name, column in columns.items():
        fields[column] = _clean(fields[column])
        if name not in JAW_CONTROLS:
            fields[column, inside] = 0.0  # only the jaw moves the mouth's inside; in other shapes this is noise
    closing = np.zeros_like(fields)
    if CLOSE in columns:
        closing[columns[CLOSE]], fields[columns[CLOSE]] = fields[columns[CLOSE]].copy(), 0.0
    turn, slide = np.zeros((m, 3)), np.zeros((m, 3))
    for name, rotation, shift in zip(JAW_CONTROLS, fit.turn_rad, fit.slide_mm, strict=True):
        turn[columns[name]], slide[columns[name]] = rotation, shift
    face = np.zeros(n, bool)
    face[segments.members("face")] = True
    regions = build_regions(x, segments.faces, segments.polygons, face, x[marks], recipe.folds, recipe.wrinkles, m)
    return {
        "neutral": np.ascontiguousarray(x.T, np.float32),
        "limits": control_limits(columns, recipe.reach),
        "controls": control_constants(columns, recipe.reach),
        "shapes": _add_bounds(_pack(fields), recipe.reach.vertex),
        "jaw": jaw.prepare(fit.weight, fit.pivot),
        "jaw_turn": turn.astype(np.float32),
        "jaw_slide": slide.astype(np.float32),
        "closing": _pack(closing),
        "wrinkles": wrinkles.prepare(regions, x, segments.faces),
    }


def _clean(offset: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    return np.where(np.linalg.norm(offset, axis=1, keepdims=True) > NOISE_MM, offset, 0.0)


def _farthest(columns: dict[str, int], reach: Reach) -> Float[np.ndarray, " m"]:
    return np.array([reach.closing if name in CLOSING else reach.control for name in columns])


def control_limits(columns: dict[str, int], reach: Reach) -> dict[str, np.ndarray]:
    """Return the limits for `saturate`: every control rests at 0 and goes as far as its reach."""
    rest = np.zeros(len(columns))
    return limits(rest, _farthest(columns, reach) / REACH, rest)


def control_constants(columns: dict[str, int], reach: Reach) -> dict[str, np.ndarray]:
    """Return the constants of `facekit_nodes.effective`: the stretch that makes 1 a full shape, blinks and gates."""
    m = len(columns)
    blink, gate, free = np.zeros((m, m)), np.zeros((m, m)), np.ones(m)
    for side in SIDES:
        blink_column = columns.get(f"eyeBlink_{side}")
        for name in (name.replace("*", side) for name in LID_CONTROLS):
            if blink_column is not None and name in columns:
                blink[blink_column, columns[name]] = 1.0
    if CLOSE in columns and "jawOpen" in columns:
        gate[columns["jawOpen"], columns[CLOSE]] = 1.0
        free[columns[CLOSE]] = 0.0
    return {
        "stretch": ((1 - _farthest(columns, reach) ** -SHARPNESS) ** (-1 / SHARPNESS)).astype(np.float32),
        "blink": blink.astype(np.float32),
        "gate": gate.astype(np.float32),
        "free": free.astype(np.float32),
    }


def _pack(fields: Float[np.ndarray, "m n 3"]) -> dict[str, np.ndarray]:
    """Return the fields (m, 3 s) on the s vertices that any of them moves, and the places of these vertices."""
    support = np.flatnonzero(np.abs(fields).max(axis=(0, 2)) > 0)
    planes = np.ascontiguousarray(fields[:, support].transpose(0, 2, 1), np.float32)
    return {"fields": planes.reshape(len(fields), -1), "place": place_of(support, fields.shape[1])}


def _add_bounds(shapes: dict[str, np.ndarray], reach: float) -> dict[str, np.ndarray]:
    """Add 1/c² of each moved vertex: c is `reach` times the farthest that any one shape moves it, in mm."""
    fields = shapes["fields"].reshape(len(shapes["fields"]), 3, -1).astype(np.float64)
    farthest = np.maximum((fields**2).sum(axis=1).max(axis=0), NOISE_MM**2)
    return shapes | {"inverse_square": (1 / (reach**2 * farthest)).astype(np.float32)}
