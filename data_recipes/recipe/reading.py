"""Reading a recipe: from a character's name or a TOML file to checked dataclasses, once."""

from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path

from data_recipes.recipe.character import Recipe
from data_recipes.recipe.facekit import FaceKitRecipe, check_parts
from data_recipes.recipe.rules import check_rules
from data_recipes.recipe.sections import Layouts
from data_recipes.recipe_paths import character_names, recipe_file, split_character
from replicate.engine.exceptions import InputError
from replicate.engine.schema import naming, read_table, shown
from replicate.engine.user_files import is_file, read_toml

UNIFORM, UNIFORM_REACH = "uniform", 0.5  # all controls at once, each within a share of its limits, must still be a face
UNIFORM_FULL = ("blink_*",)  # lids close, and nothing else reaches its limit
STEPS = tuple("123456")

__all__ = ["Recipe", "load_recipe", "with_clips", "without_place"]


def load_recipe(name_or_path: str | Path) -> Recipe | FaceKitRecipe:
    """Read and check a character's recipe; one with the key `model` is of a face in ICT-FaceKit's format.

    name_or_path: the name of a character, or the path of a TOML file.

    Raises InputError, naming file and key, for a file that can't be read, broken TOML, an unknown or missing key, or a
    value that is not allowed.
    """
    name, variants = split_character(str(name_or_path))
    path = recipe_file(name)
    if not is_file(path) and not name.endswith(".toml"):
        choices = f"{', '.join(character_names())}, or the path of a .toml recipe"
        raise InputError(f"character {shown(name)} has no recipe: allowed are {choices}")
    table = read_toml(path)
    with naming(str(path)):
        kind, check = (FaceKitRecipe, check_parts) if "model" in table else (Recipe, check_rules)
        recipe = read_table(kind, table, file=path.name)
        for variant in variants:
            recipe = _vary(recipe, variant)
        check(recipe)
    return replace(recipe, clip_files=tuple(str(path.parent / name) for name in recipe.clip_files))


def _vary(recipe: Recipe | FaceKitRecipe, variant: str) -> Recipe | FaceKitRecipe:
    """Return the variant of a recipe that an @ names. Raises InputError for one that it doesn't have."""
    if not isinstance(recipe, Recipe):
        raise InputError(f"what follows @ is {shown(variant)}: this model has no variants")
    layouts = tuple(field.name for field in fields(Layouts))
    if variant in layouts:
        return replace(recipe, layout=variant)
    if variant == UNIFORM:
        if not recipe.acting.clips and not recipe.clip_files:
            return recipe  # its poses are drawn uniformly anyway
        limits = replace(recipe.limits, reach=UNIFORM_REACH, full=UNIFORM_FULL)
        return replace(recipe, clip_files=(), acting=replace(recipe.acting, clips=0), limits=limits)
    if variant not in STEPS:
        steps = f"{STEPS[0]} to {STEPS[-1]}, a step of the ladder"
        choices = f"{', '.join(layouts)}, a layout of its charts; {steps}; or {UNIFORM}, for poses drawn uniformly"
        raise InputError(f"what follows @ is {shown(variant)}: allowed are {choices}")
    return replace(recipe, step=int(variant))


def without_place(recipe: Recipe | FaceKitRecipe) -> Recipe | FaceKitRecipe:
    """Return a recipe as the key of what is built from it has it.

    Its clips are there by name, wherever they and it lie, and of its layouts the one that counts.
    """
    recipe = replace(recipe, clip_files=tuple(Path(name).stem for name in recipe.clip_files))
    if isinstance(recipe, Recipe):
        recipe = replace(recipe, layouts=Layouts(**{recipe.layout: recipe.charts}))
    return recipe


def with_clips(recipe: Recipe | FaceKitRecipe, files: Sequence[Path]) -> Recipe | FaceKitRecipe:
    """Return a recipe whose clips lie in these files, as many as it names; more files are left out."""
    return replace(recipe, clip_files=tuple(map(str, files[: len(recipe.clip_files)])))
