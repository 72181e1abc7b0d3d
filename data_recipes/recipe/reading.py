"""Reading a recipe: from a character's name or a TOML file to checked dataclasses, once."""

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from data_recipes.recipe.character import Recipe
from data_recipes.recipe.facekit import FaceKitRecipe, check_parts
from data_recipes.recipe.sections import PARTS, Layouts
from data_recipes.recipe_paths import no_character, recipe_file, split_character
from replicate.base.exceptions import InputError
from replicate.base.schema import cut, naming, read_table, shown
from replicate.base.user_files import is_file, read_toml

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
        raise InputError(no_character(name))
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


# The rules between several keys of a recipe: rows and columns that follow each other, a width for each tooth.


def check_rules(recipe: Recipe) -> None:
    """Raise InputError, naming the key, where values of several keys don't go together."""
    t, teeth, tongue = recipe.template, recipe.teeth, recipe.tongue

    def hold(rule: bool, key: str, value: Any, requirement: str) -> None:
        if not rule:
            raise InputError(f"{key} is {cut(str(value))}: allowed is {requirement}")

    rows = [row[0] for row in t.anchors]
    growing = len(rows) > 1 and rows[0] == 0 and all(a < b for a, b in pairwise(rows))
    hold(growing, "template.anchors", rows, "two or more rows with growing row numbers from 0")
    columns, half = [row[0] for row in t.angles], t.half_columns
    growing = len(columns) > 1 and columns[0] == 0 and columns[-1] == half and all(a < b for a, b in pairwise(columns))
    hold(growing, "template.angles", columns, f"rows with growing column numbers from 0 to half_columns = {half}")
    for key in ("mouth_rows", "eye_rows", "nostril_rows", "ear_rows", "coarse_rows"):
        first, last = getattr(t, key)
        inside = t.neck_rows <= first < last <= rows[-1]
        hold(inside, f"template.{key}", [first, last], f"from neck_rows = {t.neck_rows} to {rows[-1]:g}, not empty")
    for key in ("mouth_rows", "eye_rows"):
        first, last = getattr(t, key)
        hold((last - first) % 2 == 0, f"template.{key}", [first, last], "an even number of rows apart")
    apart = t.mouth_rows[1] <= t.nostril_rows[0] and t.nostril_rows[1] <= t.eye_rows[0] and t.eye_rows[1] < t.hair_row
    requirement = "above mouth_rows and below eye_rows, those below hair_row"
    hold(apart, "template.nostril_rows", list(t.nostril_rows), requirement)
    hold(t.hair_row < rows[-1], "template.hair_row", t.hair_row, f"below the last row, {rows[-1]:g}")
    hold(t.crown_across < half, "template.crown_across", t.crown_across, f"below half_columns = {half}")
    order = (t.eye_columns[1], t.face_columns, t.ear_columns[0] - 1, t.ear_columns[1])
    inside = all(a < b for a, b in pairwise(order)) and order[-1] <= t.coarse_from < half
    requirement = "eye_columns < face_columns < ear_columns - 1, ear_columns <= coarse_from < half_columns"
    hold(inside, "template.face_columns", t.face_columns, requirement)
    widest = max(t.mouth_columns, t.nostril_columns[1])
    hold(widest < t.face_columns, "template.mouth_columns", t.mouth_columns, f"below face_columns = {t.face_columns}")
    coarse = list(t.coarse_rows)
    hold((coarse[1] - coarse[0]) % 3 == 0, "template.coarse_rows", coarse, "a multiple of 3 rows apart")
    hold(t.lip_rings < t.mouth_rings, "template.lip_rings", t.lip_rings, f"below mouth_rings = {t.mouth_rings}")
    for side in ("upper", "lower"):
        widths, half_teeth = getattr(teeth, f"widths_{side}"), getattr(teeth, side) // 2
        requirement = f"a width for each of the {half_teeth} teeth of a half"
        hold(len(widths) >= half_teeth, f"teeth.widths_{side}", f"{len(widths)} widths", requirement)
        columns = getattr(tongue, f"gum_columns_{side}")
        hold(columns % 2 == 1, f"tongue.gum_columns_{side}", columns, "an odd number")
    hold(not (tongue.cap[0] % 2 or tongue.cap[1] % 2), "tongue.cap", list(tongue.cap), "two even numbers")
    pupil, iris = recipe.eyes.pupil_deg, recipe.eyes.iris_deg
    hold(pupil < iris, "eyes.pupil_deg", pupil, f"below iris_deg = {iris:g}")
    for name in ("one_face", "fine"):
        _check_segments(f"layouts.{name}.segments", getattr(recipe.layouts, name).segments, hold)
    names = [Path(name).stem for name in recipe.clip_files]
    hold(len(set(names)) == len(names), "clip_files", list(recipe.clip_files), "files of different names")


def _check_segments(table: str, segments: dict[str, tuple[str, ...]], hold: Callable[..., None]) -> None:
    parts_in_use = [part for parts in segments.values() for part in parts]
    alone = set(PARTS) - set(parts_in_use)
    for name, parts in segments.items():
        key = f"{table}.{name}"
        hold(name.isidentifier() and name not in alone, key, repr(name), "a name that no other segment has")
        hold(len(parts) > 1, key, list(parts), "two or more parts")
        twice = [part for part in parts if parts_in_use.count(part) > 1]
        hold(not twice, key, f"'{twice[0]}' again" if twice else "", "each part once")
        hold("face" not in parts, key, "the part 'face'", "any other: the face needs all of its chart")
