"""The characters: their names, and a rig of each, built or loaded. `replicate/` takes them from here alone.

Rigs take a second to import, with JAX and scipy: that waits until one is built or loaded, since command lines come
here for names and files alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from data_recipes.acting import clip_file
from data_recipes.acting.expression_poses import expression_poses
from data_recipes.ict.facekit_files import model_files
from data_recipes.recipe.facekit import FaceKitRecipe
from data_recipes.recipe.reading import Recipe, load_recipe, with_clips, without_place
from data_recipes.recipe_paths import character_names
from data_recipes.rig import Rig

__all__ = [
    "build_from_parts",
    "build_rig",
    "character_parts",
    "expression_poses",
    "load_rig",
    "read_clip",
    "rig_names",
    "save_rig",
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
