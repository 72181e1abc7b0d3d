"""Checks of a recipe before its head is built: they take a moment, before any stage starts."""

from dataclasses import asdict
from pathlib import Path

import numpy as np

from data_recipes.acting.clip_file import read_clip
from data_recipes.controls import Control, limit_controls, make_controls
from data_recipes.head.dentition import arch, tooth_centres
from data_recipes.head.topology import build_layout, check_count
from data_recipes.ict.facekit_files import INDICES, expression_names, model_folder
from data_recipes.ict.marks import model_controls
from data_recipes.recipe.character import Recipe
from data_recipes.recipe.facekit import FaceKitRecipe
from replicate.base.exceptions import InputError
from replicate.base.user_files import shown_path

EXERCISE = 8  # the first of the acting's shots that is an exercise
MOVED = 7  # kinds of controls that a pose of an exercise moves, left and right counted as one
ROW_OF_ARCH = 1.3  # longest row of teeth over the length of its arch; ours have 0.2 to 1.0


def recipe_controls(recipe: Recipe) -> tuple[Control, ...]:
    """Return a recipe's controls. Raises InputError for limits of a control that the rig doesn't have."""
    controls = make_controls(asdict(recipe.controls), recipe.file)
    return limit_controls(controls, recipe.limits.reach, recipe.limits.full, recipe.file)


def check_early(recipe: Recipe | FaceKitRecipe) -> None:
    """Raise InputError for a clip that can't be read, and for a recipe that can't be built.

    The recipe's count of vertices is wrong, its teeth have no room, its controls are too few for the acting, or its
    model has no jaw.
    """
    if isinstance(recipe, FaceKitRecipe):
        controls = model_controls(expression_names())
        _check_jaw()
    else:
        controls = recipe_controls(recipe)
        check_count(recipe, build_layout(recipe))
        _check_rows_of_teeth(recipe)
        _check_exercises(recipe, controls)
    for file in recipe.clip_files:
        read_clip(Path(file), controls)


def _check_jaw() -> None:
    """Raise InputError for a model in ICT-FaceKit's format without the expressions that the jaw is fitted to."""
    from data_recipes.ict.jaw_fit import JAW_CONTROLS  # imports JAX, which the other checks do without

    missing = [name for name in JAW_CONTROLS if name not in expression_names()]
    if missing:
        raise InputError(
            f"{shown_path(model_folder() / INDICES)}: expressions: '{missing[0]}' is missing; the jaw is fitted to "
            f"{', '.join(JAW_CONTROLS)}"
        )


def _check_exercises(recipe: Recipe, controls: tuple[Control, ...]) -> None:
    """Raise InputError if the acting has exercises whose poses move more kinds of controls than the rig has."""
    kinds = {control.name.replace("left", "*").replace("right", "*") for control in controls}
    if recipe.acting.clips >= EXERCISE and len(kinds) < min(MOVED, len(controls)):
        raise InputError(
            f"{recipe.file}: there are {len(controls)} controls of {len(kinds)} kinds, left and right counted as one, "
            f"but an exercise moves {MOVED} kinds at once: add controls, or set acting.clips to {EXERCISE - 1} or less"
        )


def _check_rows_of_teeth(recipe: Recipe) -> None:
    """Raise InputError for teeth that are wider together than their arch is long."""
    for jaw in ("upper", "lower"):
        _, widths = tooth_centres(recipe, jaw == "upper")
        room = np.linalg.norm(np.diff(arch(recipe, 0.0, jaw == "upper"), axis=0), axis=1).sum()
        if widths.sum() > ROW_OF_ARCH * room:
            raise InputError(
                f"{recipe.file}: teeth.widths_{jaw}: the row of teeth is {widths.sum():.0f} mm long; at most "
                f"{ROW_OF_ARCH * room:.0f} mm have room, {ROW_OF_ARCH:g} times the length of the arch"
            )
