"""The characters: their names, and a rig of each, built or loaded. `replicate/` takes them from here alone.

Rigs take a second to import, with JAX and scipy: that waits until one is built or loaded, since command lines come
here for names and files alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from data_recipes.acting import clip_file
from data_recipes.acting.expression_poses import expression_poses
from data_recipes.ict.facekit_files import model_files
from data_recipes.landmark_set import FACE_LANDMARKS, region_of_landmark
from data_recipes.recipe.facekit import FaceKitRecipe
from data_recipes.recipe.reading import Recipe, load_recipe, with_clips, without_place
from data_recipes.recipe_paths import character_names
from data_recipes.rig import Rig

__all__ = [
    "FACE_LANDMARKS",
    "build_from_parts",
    "build_rig",
    "character_parts",
    "expression_poses",
    "load_rig",
    "performance",
    "read_clip",
    "rig_names",
    "save_rig",
    "with_face_landmarks",
    "write_rigify_samples",
]


def rig_names() -> tuple[str, ...]:
    """Return the names of the characters that come with the suite, and of those whose folders a variable names."""
    return character_names()


def character_parts(name_or_recipe: str | Path) -> tuple[Recipe | FaceKitRecipe, tuple[Path, ...]]:
    """Return what a character's rig is built from: what its recipe says, and the files of its clips and its model.

    The recipe is free of places, comments and layout: two that are equal give the same rig, if the files do. Raises
    InputError for a bad recipe or clip, or a model that is not there.
    """
    from data_recipes.early_checks import check_early

    recipe = load_recipe(name_or_recipe)
    check_early(recipe)
    model = model_files() if isinstance(recipe, FaceKitRecipe) else ()
    return without_place(recipe), (*map(Path, recipe.clip_files), *model)


def build_rig(name_or_recipe: str | Path) -> Rig:
    """Return a character, built from its recipe (some 15 s).

    name_or_recipe: one of `rig_names()`, or the path of a recipe in TOML. Raises InputError for a bad recipe.
    """
    return build_from_parts(*character_parts(name_or_recipe))


def build_from_parts(recipe: Recipe | FaceKitRecipe, files: Sequence[Path]) -> Rig:
    """Return the rig of what `character_parts` gives. Raises InputError for a recipe that gives no face."""
    whole = with_clips(recipe, files)
    if isinstance(recipe, FaceKitRecipe):
        from data_recipes.ict.facekit_rig import build_facekit_rig

        return build_facekit_rig(whole)
    from data_recipes.recipe_rig import build_recipe_rig

    return build_recipe_rig(whole)


def with_face_landmarks(rig: Rig, recipe: Recipe | FaceKitRecipe) -> Rig:
    """Return a rig whose control points are the 54 landmarks of performance capture (§5.3.2), in their regions.

    recipe: what the rig was built from, as `character_parts` gives it; of its head the landmarks are read off.
    """
    if isinstance(recipe, FaceKitRecipe):
        from data_recipes.ict.facekit_rig import facekit_landmarks

        vertices = facekit_landmarks(recipe)
    else:
        from data_recipes.head.face_landmarks import landmark_vertices
        from data_recipes.head.neutral_head import build_head

        vertices = landmark_vertices(build_head(recipe))
    return replace(
        rig,
        control_points=vertices,
        control_point_names=tuple(FACE_LANDMARKS),
        control_point_regions=tuple(map(region_of_landmark, FACE_LANDMARKS)),
    )


def performance(rig: Rig) -> Float32[np.ndarray, "t m"]:
    """Return a short performance, an emotion, a take and a speech, of which no training has seen a frame.

    The frames are parameters within the controls' limits, 24 a second, and the first is the neutral pose. Raises
    InputError for a rig with other controls than ours or ARKit's.
    """
    from data_recipes.fresh_acting import perform_afresh

    return perform_afresh(rig)


def load_rig(folder: Path) -> Rig:
    """Return the rig that `save_rig` wrote. Raises InputError for a damaged or missing one."""
    from data_recipes import rig_file

    return rig_file.load_rig(Path(folder))


def save_rig(rig: Rig, folder: Path) -> None:
    """Write one of our rigs into a folder (npz and JSON), to be loaded without building it again.

    Raises InputError for a rig whose function is code of its own.
    """
    from data_recipes import rig_file

    rig_file.save_rig(rig, Path(folder))


def read_clip(rig: Rig, file: Path) -> Float32[np.ndarray, "t m"]:
    """Return the poses (t, m) of a CSV file whose header names controls of the rig; the others keep their defaults.

    Raises InputError, naming file, line and control, for anything else (see clip_file.py).
    """
    return clip_file.read_clip(file, rig.controls)


def write_rigify_samples(folder: Path, character: str, poses: int, jobs: int, name: str) -> None:
    """Write the samples of Blender's Rigify face rig on a character's head into a folder, or what of them is missing.

    poses: to draw, beside all frames. Raises InputError, as where neither bpy nor Blender is there.
    """
    from data_recipes.rigify.rigify_face import write_folder

    write_folder(folder, character, poses, 0, jobs, name)
