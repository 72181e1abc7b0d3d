"""The characters as rigs, built, loaded or written. `replicate/` gets them from here only.

To import rigs takes a second, with JAX and scipy. Command lines come here for recipes and files alone, so those imports
wait inside the functions.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from jaxtyping import Float32, Int32

from data_recipes.acting import clip_file
from data_recipes.acting.arkit_names import arkit_parts, play_weights, without_counterpart
from data_recipes.acting.expressions import expression_poses
from data_recipes.acting.procedural_acting import Acting, act, act_in_arkit_names
from data_recipes.early_checks import check_early, recipe_controls
from data_recipes.function_rig import FunctionRig
from data_recipes.ict.facekit_files import expression_names, model_files
from data_recipes.landmark_set import FACE_LANDMARKS, TELLING_SHAPES, region_of_landmark
from data_recipes.recipe.facekit import FaceKitRecipe
from data_recipes.recipe.reading import Recipe, load_recipe, with_clips, without_place
from data_recipes.recipe.shapes import ShapeRecipe, load_shape_recipe
from data_recipes.recipe_paths import FACE_FILE, shape_file
from data_recipes.rig import AlteredRig, Rig
from replicate.base.exceptions import InputError

if TYPE_CHECKING:
    from data_recipes.sampled.importing import SampledRecipe
    from data_recipes.sampled.sampled_rig import SampledRig


AnyRecipe: TypeAlias = Recipe | FaceKitRecipe | ShapeRecipe

__all__ = [
    "FACE_LANDMARKS",
    "arkit_parts",
    "as_alembic",
    "build_from_parts",
    "build_rig",
    "character_parts",
    "check_blender",
    "check_empty",
    "control_count",
    "control_names",
    "expression_poses",
    "forget_folders",
    "import_sampled",
    "load_rig",
    "performance",
    "play_weights",
    "read_clip",
    "sampled_parts",
    "save_rig",
    "with_face_landmarks",
    "without_counterpart",
    "without_landmarks",
    "write_folder",
    "write_rigify_samples",
]


def character_parts(name_or_recipe: str | Path) -> tuple[AnyRecipe, tuple[Path, ...]]:
    """Return what a character's rig is built from: its recipe, and the files of its clips and its model.

    The recipe leaves out the place and layout of its file, so that equal recipes and files give equal rigs. Raises
    InputError for a bad recipe or clip, or a missing model or file.
    """
    if shape_file(str(name_or_recipe)):
        from data_recipes.shapes.shape_file import source_files

        shapes = load_shape_recipe(str(name_or_recipe))
        return replace(shapes, file=""), source_files(shapes)
    recipe = load_recipe(name_or_recipe)
    check_early(recipe)
    model = model_files() if isinstance(recipe, FaceKitRecipe) else ()
    return without_place(recipe), (*map(Path, recipe.clip_files), *model)


def control_count(recipe: AnyRecipe | SampledRecipe, files: Sequence[Path]) -> int:
    """Return how many controls a rig will have, from `character_parts` or `sampled_parts`; nothing is built."""
    return len(control_names(recipe, files))


def control_names(recipe: AnyRecipe | SampledRecipe, files: Sequence[Path]) -> list[str]:
    """Return the controls that a rig of these parts can have; nothing is built."""
    if isinstance(recipe, ShapeRecipe):
        from data_recipes.shapes.shape_file import control_names

        return control_names(recipe, files)
    if isinstance(recipe, Recipe):
        return [control.name for control in recipe_controls(recipe)]
    if isinstance(recipe, FaceKitRecipe):
        return list(expression_names())
    from data_recipes.sampled.sample_folder import open_folder

    return [control.name for control in open_folder(files[1].parent).controls]


def build_rig(name_or_recipe: str | Path) -> Rig:
    """Return a character, built from its recipe (some 15 s).

    name_or_recipe: a character's name, or the path of a recipe in TOML. Raises InputError for a bad recipe.
    """
    return build_from_parts(*character_parts(name_or_recipe))


def build_from_parts(recipe: AnyRecipe, files: Sequence[Path]) -> Rig:
    """Return the rig of what `character_parts` gives. Raises InputError for a recipe whose head is not a face."""
    if isinstance(recipe, ShapeRecipe):
        from data_recipes.shapes.shape_rig import build_shape_rig

        return build_shape_rig(recipe, files)
    whole = with_clips(recipe, files)
    if isinstance(whole, FaceKitRecipe):
        from data_recipes.ict.facekit_rig import build_facekit_rig

        return build_facekit_rig(whole)
    from data_recipes.recipe_rig import build_recipe_rig

    return build_recipe_rig(whole)


def with_face_landmarks(rig: Rig, recipe: AnyRecipe | SampledRecipe) -> Rig:
    """Return a rig whose control points are the 54 landmarks of performance capture (§5.3.2), in their regions.

    recipe: what the rig was built from, as `character_parts` or `sampled_parts` gives it. On our heads the landmarks
    are known. For others face.toml names them, and on a face of shapes those that it leaves out are found by what the
    shapes move. Raises InputError for one that is missing or no vertex of the rig.
    """
    if not isinstance(recipe, (Recipe, FaceKitRecipe)):
        vertices = _named_landmarks(rig, recipe)
    elif isinstance(recipe, FaceKitRecipe):
        from data_recipes.ict.facekit_rig import facekit_landmarks

        vertices = facekit_landmarks(recipe)
    else:
        from data_recipes.head.face_landmarks import landmark_vertices
        from data_recipes.head.neutral_head import build_head

        vertices = landmark_vertices(build_head(recipe))
    points = {
        "control_points": vertices,
        "control_point_names": tuple(FACE_LANDMARKS),
        "control_point_regions": tuple(map(region_of_landmark, FACE_LANDMARKS)),
    }
    return replace(rig, **points) if isinstance(rig, FunctionRig) else AlteredRig(rig, **points)


def without_landmarks(recipe: AnyRecipe | SampledRecipe, files: Sequence[Path]) -> str:
    """Return which landmarks of performance capture a face lacks, in a sentence; "" for a face that may have all.

    recipe, files: as `character_parts` or `sampled_parts` gives them; nothing is built.
    """
    if isinstance(recipe, (Recipe, FaceKitRecipe)) or len(recipe.face.points.face_landmarks) == len(FACE_LANDMARKS):
        return ""
    unknown = ""
    if isinstance(recipe, ShapeRecipe):
        lacking = without_counterpart(TELLING_SHAPES, control_names(recipe, files))
        if not lacking:
            return ""
        unknown = f", nor can be found, since no shape is called {' or '.join(lacking)}"
    return _unnamed(recipe, unknown)


def _unnamed(recipe: ShapeRecipe | SampledRecipe, why: str) -> str:
    missing = [name for name in FACE_LANDMARKS if name not in recipe.face.points.face_landmarks]
    few = len(missing) < len(FACE_LANDMARKS)
    lack = f"{len(missing)} of its {len(FACE_LANDMARKS)} landmarks have no vertex{why}: {', '.join(missing)}"
    lack = lack if few else f"none of its {len(FACE_LANDMARKS)} landmarks has a vertex{why}"
    return f"{lack}; name them in {FACE_FILE}, [points.face_landmarks], as REPRODUCING.md says"


def _named_landmarks(rig: Rig, recipe: ShapeRecipe | SampledRecipe) -> Int32[np.ndarray, " l"]:
    """Return the rig's vertices of the landmarks that a face.toml names by the vertices of the mesh's file.

    On a face of shapes the others are found.
    """
    named = recipe.face.points.face_landmarks
    place = np.asarray(getattr(rig, "file_vertices", ()))
    place = place if len(place) else np.arange(len(rig.mesh.neutral))
    for name, vertex in named.items():
        where = f"{FACE_FILE}: points.face_landmarks.{name}"
        if vertex >= len(place):
            raise InputError(f"{where}: expected a vertex from 0 to {len(place) - 1}, got {vertex}")
        if place[vertex] < 0:
            raise InputError(
                f"{where}: expected a vertex that a control can move, got {vertex}, of a part that is still"
            )
    found = {name: int(place[vertex]) for name, vertex in named.items()}
    if len(found) < len(FACE_LANDMARKS):
        if not isinstance(recipe, ShapeRecipe):
            raise InputError(f"{rig.name}: {_unnamed(recipe, '')}")
        from data_recipes.shapes.found_landmarks import found_landmarks

        try:
            found = found_landmarks(rig, found)
        except InputError as error:
            raise InputError(f"{rig.name}: {_unnamed(recipe, f', nor can be found: {error}')}") from None
    return np.array([found[name] for name in FACE_LANDMARKS], np.int32)


PERFORMANCE = Acting(seed=54, clips=3, clip_s=4.0)  # an emotion, a take and a dialogue


def performance(rig: Rig) -> Float32[np.ndarray, "t m"]:
    """Return a short performance to be captured (§5.3.2), of which no training has seen a frame.

    The frames are parameters within the controls' limits, 24 a second; each of its three shots begins in the neutral
    pose. Raises InputError for a rig with other controls than ours or ARKit's.
    """
    for shots in (act, act_in_arkit_names):
        values = np.concatenate([values for _, values in shots(rig.controls, PERFORMANCE)])
        if (values != rig.default).any():
            return np.clip(values, rig.lower, rig.upper).astype(np.float32)
    raise InputError(f"rig '{rig.name}': it has none of the controls that our acting moves, so it can't be the actor")


def sampled_parts(folder: Path) -> tuple[SampledRecipe, tuple[Path, ...]]:
    """Return what the rig of a folder of samples is made from: what its `face.toml` says, and its other files.

    A process reads the folder once; shards that come later belong to the next run. Raises InputError for a folder that
    contradicts itself.
    """
    from data_recipes.sampled.importing import SampledRecipe
    from data_recipes.sampled.sample_folder import open_folder

    found = open_folder(folder)
    return SampledRecipe(found.face), found.files


def forget_folders() -> None:
    """Forget what folders of samples hold, so that shards which came since are seen."""
    if reader := sys.modules.get("data_recipes.sampled.sample_folder"):  # a second's work to import
        reader.open_folder.cache_clear()
    if reader := sys.modules.get("data_recipes.sampled.one_pose_each"):
        reader.has_one_pose_each.cache_clear()
        reader.open_poses.cache_clear()


def import_sampled(recipe: SampledRecipe, files: Sequence[Path], target: Path, progress: Callable) -> SampledRig:
    """Return the rig of what `sampled_parts` gives, and write it into a folder. Raises InputError for bad poses."""
    from data_recipes.sampled import sampled_rig
    from data_recipes.sampled.importing import import_rig

    target.mkdir(parents=True, exist_ok=True)
    rig = import_rig(recipe, files, target, progress)
    sampled_rig.save_rig(rig, target)
    return rig


def write_folder(
    rig: Rig,
    folder: Path,
    total: int,
    shards: Iterable[Mapping[str, np.ndarray]],
    progress: Callable | None = None,
    moves: np.ndarray | None = None,
) -> None:
    """Write a rig as a folder of samples (see sampled/writing.py).

    total: how many poses the shards hold together
    shards: the arrays of each shard without the vertices, which the rig gives
    progress: (total, label) → a context manager with update(k)
    moves: which control moves which vertex, (n, m), if the folder is to say so

    Raises InputError for a folder that is not empty.
    """
    from data_recipes.sampled import writing

    writing.write_folder(rig, folder, total, shards, progress, moves)


def check_empty(folder: Path) -> None:
    """Raise InputError for a place where `write_folder` can't write."""
    from data_recipes.sampled import writing

    writing.check_empty(folder)


def load_rig(folder: Path) -> Rig:
    """Return the rig that `save_rig` or `import_sampled` wrote. Raises InputError for a damaged or missing one."""
    from data_recipes import rig_file
    from data_recipes.sampled import sampled_rig

    kind = sampled_rig if sampled_rig.is_sampled(Path(folder)) else rig_file
    return kind.load_rig(Path(folder))


def save_rig(rig: Rig, folder: Path) -> None:
    """Write one of our rigs into a folder (npz and JSON), to be loaded without building it again.

    Raises InputError for a rig that was not built from a recipe.
    """
    from data_recipes import rig_file

    rig_file.save_rig(rig, Path(folder))


def read_clip(rig: Rig, file: Path) -> Float32[np.ndarray, "t m"]:
    """Return the poses (t, m) of a CSV file whose header names controls of the rig; the others keep their defaults.

    Raises InputError, naming file, line and control, for anything else (see clip_file.py).
    """
    return clip_file.read_clip(file, rig.controls)


def write_rigify_samples(folder: Path, character: str, poses: int, jobs: int, name: str) -> None:
    """Write those samples of Blender's Rigify face rig on a character's head that a folder still lacks.

    character: the name of the one whose head it is
    poses: how many to draw, besides all frames
    jobs: how many processes run at once
    name: of the rig in the folder

    Raises InputError, for example where neither bpy nor Blender is installed.
    """
    from data_recipes.rigify.rigify_face import write_folder

    write_folder(folder, character, poses, 0, jobs, name)


def check_blender() -> None:
    """Raise InputError where neither bpy nor Blender is installed."""
    from data_recipes.exporters.blender_python import blender_python

    blender_python()


def as_alembic(usd: bytes, frames_per_second: float) -> bytes:
    """Return a binary USD as Alembic. Raises InputError where neither bpy nor Blender is installed."""
    from data_recipes.exporters.blender_python import through_blender

    return through_blender(usd, ".usdc", ".abc", frames_per_second)
