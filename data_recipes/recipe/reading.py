"""Reading a recipe: from a character's name or a TOML file to checked dataclasses, once."""

from collections.abc import Sequence
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

UNIFORM, UNIFORM_REACH = "uniform", 0.5  # the share of their limits within which all controls at once still give a face
UNIFORM_FULL = ("blink_*",)  # lids close; no other control reaches its limit
STEPS = tuple("123456")

__all__ = ["Recipe", "load_recipe", "with_clips", "without_place"]


def load_recipe(name_or_path: str | Path) -> Recipe | FaceKitRecipe:
    """Read and check a character's recipe; one with the key `model` is of a face in ICT-FaceKit's format.

    name_or_path: the name of a character, or the path of a TOML file.
    Raises InputError, naming file and key, for a file that can't be read, broken TOML, an unknown or missing key, or a
    wrong value.
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
    """Return the variant of a recipe that follows an @. Raises InputError for one that it doesn't have."""
    if not isinstance(recipe, Recipe):
        raise InputError(f"after @: got {shown(variant)}, but this model has no variants")
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
        raise InputError(f"after @: expected {choices}, got {shown(variant)}")
    return replace(recipe, step=int(variant))


def without_place(recipe: Recipe | FaceKitRecipe) -> Recipe | FaceKitRecipe:
    """Return a recipe for the key of its character: its clips by name without their folders, and the layout in use."""
    recipe = replace(recipe, clip_files=tuple(Path(name).stem for name in recipe.clip_files))
    if isinstance(recipe, Recipe):
        recipe = replace(recipe, layouts=Layouts(**{recipe.layout: recipe.charts}))
    return recipe


def with_clips(recipe: Recipe | FaceKitRecipe, files: Sequence[Path]) -> Recipe | FaceKitRecipe:
    """Return a recipe whose clips lie in the first of these files, as many as it names."""
    return replace(recipe, clip_files=tuple(map(str, files[: len(recipe.clip_files)])))


# The rules between several keys of a recipe: rows and columns that follow each other, a width for each tooth.


def check_rules(recipe: Recipe) -> None:
    """Raise InputError, naming the key, where values of several keys don't go together."""
    t, teeth, tongue = recipe.template, recipe.teeth, recipe.tongue

    # the template's grid
    rows = [row[0] for row in t.anchors]
    growing = len(rows) > 1 and rows[0] == 0 and all(a < b for a, b in pairwise(rows))
    _require(growing, "template.anchors", "two or more rows with growing row numbers from 0", rows)
    columns, half = [row[0] for row in t.angles], t.half_columns
    growing = len(columns) > 1 and columns[0] == 0 and columns[-1] == half and all(a < b for a, b in pairwise(columns))
    _require(growing, "template.angles", f"rows with growing column numbers from 0 to half_columns = {half}", columns)

    # the rows of its holes, from the neck upwards
    for key in ("mouth_rows", "eye_rows", "nostril_rows", "ear_rows", "coarse_rows"):
        first, last = getattr(t, key)
        expected = f"two different rows from neck_rows = {t.neck_rows} to {rows[-1]:g}"
        _require(t.neck_rows <= first < last <= rows[-1], f"template.{key}", expected, [first, last])
    for key in ("mouth_rows", "eye_rows"):
        first, last = getattr(t, key)
        _require((last - first) % 2 == 0, f"template.{key}", "rows an even number apart", [first, last])
    apart = t.mouth_rows[1] <= t.nostril_rows[0] and t.nostril_rows[1] <= t.eye_rows[0] and t.eye_rows[1] < t.hair_row
    expected = "rows above mouth_rows and below eye_rows, which are below hair_row"
    _require(apart, "template.nostril_rows", expected, list(t.nostril_rows))
    _require(t.hair_row < rows[-1], "template.hair_row", f"a row below the last one, {rows[-1]:g}", t.hair_row)
    coarse = list(t.coarse_rows)
    _require((coarse[1] - coarse[0]) % 3 == 0, "template.coarse_rows", "rows a multiple of 3 apart", coarse)

    # their columns, from the middle outwards, and their rings
    _require(t.crown_across < half, "template.crown_across", f"fewer than half_columns = {half}", t.crown_across)
    order = (t.eye_columns[1], t.face_columns, t.ear_columns[0] - 1, t.ear_columns[1])
    inside = all(a < b for a, b in pairwise(order)) and order[-1] <= t.coarse_from < half
    expected = "eye_columns < face_columns < ear_columns - 1, ear_columns <= coarse_from < half_columns"
    _require(inside, "template.face_columns", expected, t.face_columns)
    for key, columns in (("mouth_columns", t.mouth_columns), ("nostril_columns", t.nostril_columns[1])):
        _require(columns < t.face_columns, f"template.{key}", f"fewer than face_columns = {t.face_columns}", columns)
    _require(
        t.lip_rings < t.mouth_rings, "template.lip_rings", f"fewer than mouth_rings = {t.mouth_rings}", t.lip_rings
    )

    # mouth, eyes, charts and clips
    for side in ("upper", "lower"):
        widths, half_teeth = getattr(teeth, f"widths_{side}"), getattr(teeth, side) // 2
        expected = f"a width for each of the {half_teeth} teeth of a half"
        _require(len(widths) >= half_teeth, f"teeth.widths_{side}", expected, f"{len(widths)} widths")
        columns = getattr(tongue, f"gum_columns_{side}")
        _require(columns % 2 == 1, f"tongue.gum_columns_{side}", "an odd number", columns)
    _require(not (tongue.cap[0] % 2 or tongue.cap[1] % 2), "tongue.cap", "two even numbers", list(tongue.cap))
    pupil, iris = recipe.eyes.pupil_deg, recipe.eyes.iris_deg
    _require(pupil < iris, "eyes.pupil_deg", f"less than iris_deg = {iris:g}", pupil)
    for name in ("one_face", "fine"):
        _check_segments(f"layouts.{name}.segments", getattr(recipe.layouts, name).segments)
    names = [Path(name).stem for name in recipe.clip_files]
    _require(len(set(names)) == len(names), "clip_files", "files of different names", list(recipe.clip_files))


def _require(rule: bool, key: str, expected: str, found: Any) -> None:
    if not rule:
        raise InputError(f"{key}: expected {expected}, got {cut(str(found))}")


def _check_segments(table: str, segments: dict[str, tuple[str, ...]]) -> None:
    parts_in_use = [part for parts in segments.values() for part in parts]
    alone = set(PARTS) - set(parts_in_use)
    for name, parts in segments.items():
        key = f"{table}.{name}"
        _require(name.isidentifier() and name not in alone, key, "a name that no other segment has", repr(name))
        _require(len(parts) > 1, key, "two or more parts", list(parts))
        twice = [part for part in parts if parts_in_use.count(part) > 1]
        _require(not twice, key, "each part once", f"'{twice[0]}' again" if twice else "")
        _require("face" not in parts, key, "parts other than 'face', which needs all of its chart", list(parts))
