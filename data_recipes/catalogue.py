"""The characters: their names, and a rig of each, built or loaded. `replicate/` takes them from here alone.

Rigs take a second to import, with JAX and scipy: that waits until one is built or loaded, since command lines come
here for names and files alone.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float32

from data_recipes.acting import clip_file
from data_recipes.acting.expression_poses import expression_poses
from data_recipes.acting.procedural_acting import Acting, act
from data_recipes.ict.facekit_acting import perform
from data_recipes.ict.facekit_files import expression_names, model_files
from data_recipes.landmark_set import FACE_LANDMARKS, region_of_landmark
from data_recipes.recipe.facekit import FaceKitRecipe
from data_recipes.recipe.reading import Recipe, load_recipe, with_clips, without_place
from data_recipes.recipe_paths import character_names
from data_recipes.rig import AlteredRig, Rig
from replicate.base.exceptions import InputError

if TYPE_CHECKING:
    from data_recipes.sampled.importing import SampledRecipe
    from data_recipes.sampled.sampled_rig import SampledRig


__all__ = [
    "FACE_LANDMARKS",
    "build_from_parts",
    "build_rig",
    "character_parts",
    "check_empty",
    "control_count",
    "expression_poses",
    "forget_folders",
    "import_sampled",
    "load_rig",
    "performance",
    "read_clip",
    "rig_names",
    "sampled_parts",
    "save_rig",
    "with_face_landmarks",
    "write_folder",
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


def control_count(recipe: Recipe | FaceKitRecipe | SampledRecipe, files: Sequence[Path]) -> int:
    """Return how many controls the rig of what `character_parts` or `sampled_parts` gives has; nothing is built."""
    from data_recipes.early_checks import recipe_controls
    from data_recipes.sampled.face_file import read_controls

    if isinstance(recipe, Recipe):
        return len(recipe_controls(recipe))
    return len(expression_names() if isinstance(recipe, FaceKitRecipe) else read_controls(files[1].parent))


def build_rig(name_or_recipe: str | Path) -> Rig:
    """Return a character, built from its recipe (some 15 s).

    name_or_recipe: one of `rig_names()`, or the path of a recipe in TOML. Raises InputError for a bad recipe.
    """
    return build_from_parts(*character_parts(name_or_recipe))


def build_from_parts(recipe: Recipe | FaceKitRecipe, files: Sequence[Path]) -> Rig:
    """Return the rig of what `character_parts` gives. Raises InputError for a recipe that gives no face."""
    whole = with_clips(recipe, files)
    if isinstance(whole, FaceKitRecipe):
        from data_recipes.ict.facekit_rig import build_facekit_rig

        return build_facekit_rig(whole)
    from data_recipes.recipe_rig import build_recipe_rig

    return build_recipe_rig(whole)


def with_face_landmarks(rig: Rig, recipe: Recipe | FaceKitRecipe) -> Rig:
    """Return a rig whose control points are the 54 landmarks of performance capture (§5.3.2), in their regions.

    recipe: what the rig was built from, as `character_parts` gives it; of its head the landmarks are read off.
    """
    from data_recipes.function_rig import FunctionRig

    if isinstance(recipe, FaceKitRecipe):
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


def performance(rig: Rig) -> Float32[np.ndarray, "t m"]:
    """Return a short performance, an emotion, a take and a speech, of which no training has seen a frame.

    The frames are parameters within the controls' limits, 24 a second, and the first is the neutral pose. Raises
    InputError for a rig with other controls than ours or ARKit's.
    """
    return perform_afresh(rig)


def sampled_parts(folder: Path) -> tuple[SampledRecipe, tuple[Path, ...]]:
    """Return what the rig of a folder of samples is made from: what its `face.toml` says, and its other files.

    Raises InputError for a folder that contradicts itself. What it holds is read once a process: shards that come later
    belong to the next run.
    """
    from data_recipes.sampled.importing import SampledRecipe
    from data_recipes.sampled.sample_folder import open_folder

    found = open_folder(folder)
    return SampledRecipe(found.face), found.files


def forget_folders() -> None:
    """Forget what folders of samples hold, so that shards which came since are seen."""
    if reader := sys.modules.get("data_recipes.sampled.sample_folder"):  # a second's work to import
        reader.open_folder.cache_clear()


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
    """Write a rig as a folder of samples (see sampled/writing.py). Raises InputError for a folder that is not empty."""
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


# A performance that is in no character's animation: the same acting from another seed, to be captured (§5.3.2).

AFRESH = Acting(seed=54, clips=3, clip_s=4.0)  # an emotion, a take and a dialogue


def perform_afresh(rig: Rig) -> Float32[np.ndarray, "t m"]:
    """Return the frames of the performance, (t, m) within the controls' limits, 24 a second; each shot begins at rest.

    Raises InputError for a rig with other controls than ours or ARKit's.
    """
    for shots in (act, perform):
        values = np.concatenate([values for _, values in shots(rig.controls, AFRESH)])
        if (values != rig.default).any():
            return np.clip(values, rig.lower, rig.upper).astype(np.float32)
    raise InputError(f"rig '{rig.name}': it has none of the controls that our acting moves, so it can't be the actor.")
