"""What a face of summed shapes is read from: a glTF with morph targets, or a folder with a mesh or a pose a shape."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from data_recipes.controls import Control
from data_recipes.gltf.document import buffer_files
from data_recipes.gltf.gltf_face import GltfSkin, read_gltf
from data_recipes.recipe.shapes import GUESS, ShapeFace, ShapeRecipe
from data_recipes.recipe_paths import CONTROL_FILE, FACE_FILE, MESH_ENDINGS, SHAPE_ENDINGS, SHAPE_MESHES
from data_recipes.sampled.face_file import MM, in_our_axes, read_controls
from data_recipes.sampled.mesh_file import NeutralFile, neutral_of, read_mesh
from data_recipes.sampled.one_pose_each import Shape, open_poses, posed_shapes, read_poses
from replicate.base.exceptions import InputError
from replicate.base.spelling import meant, nothing_named
from replicate.base.user_files import is_file, shown_path

NEUTRAL_NAMES = ("neutral", "base", "basis", "rest", "default", "mean")
MOST_SHAPES = 2_000
GUESSED_UNITS = ("m", "cm", "mm")  # the first that makes the face as large as a face
FACE_MM = (60.0, 600.0)


def source_files(recipe: ShapeRecipe) -> tuple[Path, ...]:
    """Return the files of a face of shapes: a glTF and its buffers, or the neutral and the shapes in order of names.

    Of a folder of samples with a pose for each shape: the neutral, the controls, the shards and the neutral's buffers.
    """
    place = Path(recipe.file)
    if not place.is_dir():
        if not is_file(place):
            beside = {file.stem: file.name for file in place.parent.glob("*") if file.suffix.lower() in SHAPE_ENDINGS}
            near = beside.get(meant(place.stem, beside), "")
            raise InputError(f"{shown_path(place)}: there is no such file{near and f'; did you mean {near}?'}")
        return (place, *(file for file in buffer_files(place) if file != place))
    if is_file(place / CONTROL_FILE):
        meshes = sorted(file for file in place.iterdir() if file.suffix.lower() in MESH_ENDINGS)
        neutral = meshes[0] if len(meshes) == 1 else _neutral_among(meshes, recipe)
        return open_poses(place, neutral.name).files
    meshes = sorted(file for file in place.iterdir() if file.suffix.lower() in SHAPE_MESHES)
    if len(meshes) > MOST_SHAPES:
        raise InputError(f"{shown_path(place)}: expected at most {MOST_SHAPES:,} shapes, got {len(meshes):,}")
    neutral = _neutral_among(meshes, recipe)
    shapes = [file for file in meshes if file != neutral]
    if not shapes:
        raise InputError(f"{shown_path(place)}: expected a mesh for each shape beside {neutral.name}, got none")
    return (neutral, *shapes)


def _neutral_among(meshes: Sequence[Path], recipe: ShapeRecipe) -> Path:
    place, stated = Path(recipe.file), recipe.face.mesh
    wanted = [file for file in meshes if (file.name == stated if stated else file.stem.lower() in NEUTRAL_NAMES)]
    if stated and not wanted:
        raise InputError(f"{shown_path(place / stated)}: there is no such file")
    if not wanted:
        remedy = f"call it one of {', '.join(NEUTRAL_NAMES)}, or name it in {FACE_FILE}, mesh = …"
        raise InputError(f"{shown_path(place)}: which of {len(meshes)} meshes is the neutral face? {remedy}")
    return wanted[0]


def is_posed(files: Sequence[Path]) -> bool:
    """Return whether the files of a face, as `source_files` lists them, are samples with a pose for each shape."""
    return len(files) > 1 and files[1].name == CONTROL_FILE


@dataclass(frozen=True)
class ShapeSource:
    """A face as its files have it, in mm and our axes.

    neutral: n vertices, with faces, charts and labels; its `vertices` are in mm already.
    shapes: of all controls, in their order, mm.
    weights: control → its weight in the neutral face, of which the file's vertices have nothing.
    controls: what is said of some of them, by their names.
    skin: joints, in the file's unit, or None.
    to_ours: brings a column of the file's unit and axes into mm and ours.
    colours: of the vertices, from 0 to 1, or None.
    """

    neutral: NeutralFile
    shapes: tuple[Shape, ...]
    weights: Mapping[str, float]
    controls: Mapping[str, Control]
    skin: GltfSkin | None
    to_ours: Float[np.ndarray, "3 3"]
    colours: Float[np.ndarray, "n 3"] | None


def read_source(face: ShapeFace, files: tuple[Path, ...]) -> ShapeSource:
    """Read the files of a face of shapes, as `source_files` lists them.

    Raises InputError, naming the file, for one without shapes or with another number of vertices.
    """
    file, skin, colours = files[0], None, None
    where, weights, controls = shown_path(file), {}, {}
    turn = in_our_axes(np.eye(3), face.up).T
    if is_posed(files):
        samples = read_poses(files)
        vertices, shapes = posed_shapes(samples)
        neutral = replace(samples.neutral, vertices=vertices)
        controls = {control.name: control for control in samples.controls}
    elif file.suffix.lower() in SHAPE_ENDINGS:
        found = read_gltf(file)
        if not found.targets and not face.joints:
            raise InputError(
                f"{where}: it has no morph targets, so nothing can move: export it with shape keys, or name joints of "
                f"its skin in a {FACE_FILE} beside it"
            )
        neutral = neutral_of(found)
        shapes = [Shape(name, offsets) for name, offsets in found.targets.items()]
        weights, skin, colours = found.weights, found.skin, found.base_colour
        turn = np.diag([-1.0, 1.0, -1.0]) if found.looks_back else np.eye(3)
    else:
        neutral = read_mesh(file)
        shapes = []
        for shape in files[1:]:
            vertices = read_mesh(shape).vertices
            if vertices.shape != neutral.vertices.shape:
                n = len(neutral.vertices)
                raise InputError(f"{shown_path(shape)}: expected the {n} vertices of {file.name}, got {len(vertices)}")
            shapes.append(Shape(shape.stem, vertices - neutral.vertices))
    mm = _unit_mm(face, neutral.vertices, shapes, where)
    to_ours = mm * turn
    in_mm = replace(neutral, vertices=neutral.vertices @ to_ours.T)
    ours = tuple(replace(shape, offsets=shape.offsets @ to_ours.T) for shape in shapes)
    return ShapeSource(in_mm, ours, weights, controls, skin, to_ours, colours)


def control_names(recipe: ShapeRecipe, files: Sequence[Path]) -> list[str]:
    """Return the names of the controls that a rig of these files has at most."""
    joints = [f"{joint}_{axis}" for joint, axes in recipe.face.joints.items() for axis in axes]
    if is_posed(files):
        return [line.name for line in read_controls(files[0].parent)]
    if files[0].suffix.lower() in SHAPE_MESHES:
        return [*(file.stem for file in files[1:]), *joints]
    return [*read_gltf(files[0]).targets, *joints]


def _unit_mm(face: ShapeFace, vertices: np.ndarray, shapes: Sequence[Shape], where: str) -> float:
    """Return the unit in mm: the face's own, or the one that makes what moves as large as a face.

    Raises InputError where what moves is far from as large as a face in the unit, or in all of them.
    """
    moving = np.zeros(len(vertices), bool)
    for shape in shapes:
        moving |= shape.offsets.any(axis=1)
    size = float(np.ptp(vertices[moving] if moving.any() else vertices, axis=0).max())
    if face.unit != GUESS:
        least, most = FACE_MM[0] / 2, FACE_MM[1] * 2
        if not least <= size * MM[face.unit] <= most:
            raise InputError(
                f"{where}: with unit = {face.unit!r} in {FACE_FILE} what moves is {size * MM[face.unit]:.3g} mm large, "
                f"expected {least:g} to {most:,.0f} mm"
            )
        return MM[face.unit]
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
                raise InputError(f"{where}, by the {FACE_FILE} beside it: {nothing_named(kind, name, known, others)}")
