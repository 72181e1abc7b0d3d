"""What a face of summed shapes is read from: a glTF with morph targets, or a folder with a mesh for each shape."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from data_recipes.gltf.document import buffer_files
from data_recipes.gltf.gltf_face import GltfSkin, read_gltf
from data_recipes.recipe.shapes import GUESS, ShapeFace, ShapeRecipe
from data_recipes.recipe_paths import FACE_FILE, SHAPE_ENDINGS, SHAPE_MESHES
from data_recipes.sampled.face_file import MM, in_our_axes
from data_recipes.sampled.mesh_file import NeutralFile, neutral_of, read_mesh
from replicate.base.exceptions import InputError
from replicate.base.spelling import meant, nothing_named
from replicate.base.user_files import is_file, shown_path

NEUTRAL_NAMES = ("neutral", "base", "basis", "rest", "default", "mean")
MOST_SHAPES = 2_000
GUESSED_UNITS = ("m", "cm", "mm")  # the first that makes the face as large as a face
FACE_MM = (60.0, 600.0)


def source_files(recipe: ShapeRecipe) -> tuple[Path, ...]:
    """Return the files of a face of shapes: a glTF and its buffers, or the neutral and the shapes in order of names."""
    place = Path(recipe.file)
    if not place.is_dir():
        if not is_file(place):
            beside = {file.stem: file.name for file in place.parent.glob("*") if file.suffix.lower() in SHAPE_ENDINGS}
            near = beside.get(meant(place.stem, beside), "")
            raise InputError(f"{shown_path(place)}: there is no such file{near and f'; did you mean {near}?'}")
        return (place, *(file for file in buffer_files(place) if file != place))
    meshes = sorted(file for file in place.iterdir() if file.suffix.lower() in SHAPE_MESHES)
    if len(meshes) > MOST_SHAPES:
        raise InputError(f"{shown_path(place)}: expected at most {MOST_SHAPES:,} shapes, got {len(meshes):,}")
    stated = recipe.face.mesh
    wanted = [file for file in meshes if (file.name == stated if stated else file.stem.lower() in NEUTRAL_NAMES)]
    if not wanted:
        remedy = f"call it one of {', '.join(NEUTRAL_NAMES)}, or name it in {FACE_FILE}, mesh = …"
        raise InputError(f"{shown_path(place)}: which of {len(meshes)} meshes is the neutral face? {remedy}")
    neutral = wanted[0]
    shapes = [file for file in meshes if file != neutral]
    if not shapes:
        raise InputError(f"{shown_path(place)}: expected a mesh for each shape beside {neutral.name}, got none")
    return (neutral, *shapes)


@dataclass(frozen=True)
class ShapeSource:
    """A face as its files have it, in mm and our axes.

    neutral: n vertices, with faces, charts and labels; its `vertices` are in mm already.
    targets: shape → offsets of the vertices, mm.
    weights: shape → its weight in the neutral face.
    skin: joints, in the file's unit, or None.
    to_ours: brings a column of the file's unit and axes into mm and ours.
    colours: of the vertices, from 0 to 1, or None.
    """

    neutral: NeutralFile
    targets: dict[str, Float[np.ndarray, "n 3"]]
    weights: Mapping[str, float]
    skin: GltfSkin | None
    to_ours: Float[np.ndarray, "3 3"]
    colours: Float[np.ndarray, "n 3"] | None


def read_source(face: ShapeFace, files: tuple[Path, ...]) -> ShapeSource:
    """Read the files of a face of shapes, as `source_files` lists them.

    Raises InputError, naming the file, for one without shapes or with another number of vertices.
    """
    file = files[0]
    where = shown_path(file)
    if file.suffix.lower() in SHAPE_ENDINGS:
        found = read_gltf(file)
        if not found.targets and not face.joints:
            raise InputError(
                f"{where}: it has no morph targets, so nothing can move: export it with shape keys, or name joints of "
                f"its skin in a {FACE_FILE} beside it"
            )
        neutral = neutral_of(found)
        targets, weights, skin, colours = found.targets, found.weights, found.skin, found.base_colour
    else:
        neutral = read_mesh(file)
        targets = {}
        for shape in files[1:]:
            vertices = read_mesh(shape).vertices
            if vertices.shape != neutral.vertices.shape:
                n = len(neutral.vertices)
                raise InputError(f"{shown_path(shape)}: expected the {n} vertices of {file.name}, got {len(vertices)}")
            targets[shape.stem] = vertices - neutral.vertices
        weights, skin, colours = dict.fromkeys(targets, 0.0), None, None
    turn = np.eye(3)
    if file.suffix.lower() not in SHAPE_ENDINGS:
        turn = in_our_axes(turn, face.up).T
    elif found.looks_back:
        turn = np.diag([-1.0, 1.0, -1.0])
    mm = _guess_unit(neutral.vertices, targets, where) if face.unit == GUESS else MM[face.unit]
    to_ours = mm * turn
    in_mm = replace(neutral, vertices=neutral.vertices @ to_ours.T)
    return ShapeSource(in_mm, {k: v @ to_ours.T for k, v in targets.items()}, weights, skin, to_ours, colours)


def control_names(recipe: ShapeRecipe, files: Sequence[Path]) -> list[str]:
    """Return the names of the controls that a rig of these files has at most."""
    joints = [f"{joint}_{axis}" for joint, axes in recipe.face.joints.items() for axis in axes]
    if files[0].suffix.lower() in SHAPE_MESHES:
        return [*(file.stem for file in files[1:]), *joints]
    return [*read_gltf(files[0]).targets, *joints]


def _guess_unit(vertices: np.ndarray, targets: Mapping[str, np.ndarray], where: str) -> float:
    """Return the unit in mm that makes what moves as large as a face. Raises InputError where none does."""
    moving = np.zeros(len(vertices), bool)
    for offsets in targets.values():
        moving |= offsets.any(axis=1)
    size = float(np.ptp(vertices[moving] if moving.any() else vertices, axis=0).max())
    for unit in GUESSED_UNITS:
        if FACE_MM[0] <= size * MM[unit] <= FACE_MM[1]:
            return MM[unit]
    sizes = ", ".join(f"{size * MM[unit]:.3g} mm in {unit}" for unit in GUESSED_UNITS)
    raise InputError(f'{where}: what moves is {sizes}: name its unit in a {FACE_FILE} beside it, such as unit = "m"')


def check_names(face: ShapeFace, controls: list[str], joints: tuple[str, ...], where: str) -> None:
    """Raise InputError for limits of a control, or for a joint, that the file doesn't have."""
    for kind, given, known in (("control", face.limits, controls), ("joint", face.joints, joints)):
        for name in given:
            if name not in known:
                others = f": there are {', '.join(known[:12])}" if known else f": there is no {kind}"
                raise InputError(f"{where}: {nothing_named(kind, name, known, others)}")
