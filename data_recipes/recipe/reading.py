"""Recipes: a character as numbers and choices in one TOML file, checked before anything is built.

Every key has a default, a type and a range (see `data_recipes.recipe.sections`); whatever doesn't fit raises
`InputError` with the file, the key, what was found and what is allowed.
"""

from __future__ import annotations

import tomllib
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from data_recipes.acting.procedural_acting import Acting
from data_recipes.recipe.sections import (
    PARTS,
    Controls,
    Ears,
    Eyes,
    Frills,
    Limits,
    Mouth,
    Nose,
    Props,
    Skull,
    Teeth,
    Template,
    Tongue,
)
from replicate.engine.exceptions import InputError


@dataclass(frozen=True)
class Recipe:
    """One character.

    vertices: the exact count that the built head must have. clip_files: animation of one's own as CSV (see
    `clip_file`), beside the invented acting or, with acting.clips = 0, instead of it; in the file their paths are
    relative to its folder. A recipe with neither has no animation, and its poses are drawn uniformly. segments: which
    parts of the head share a segment, and so a chart, by the segment's name; every other part is a segment.
    """

    name: str
    vertices: int
    file: str = "<memory>"
    clip_files: tuple[str, ...] = field(default=(), metadata={"kind": "files"})
    segments: dict[str, tuple[str, ...]] = field(
        default_factory=lambda: {"lids_inner": ("lid_inner_left", "lid_inner_right")}, metadata={"kind": "groups"}
    )
    skull: Skull = field(default_factory=Skull)
    nose: Nose = field(default_factory=Nose)
    eyes: Eyes = field(default_factory=Eyes)
    mouth: Mouth = field(default_factory=Mouth)
    ears: Ears = field(default_factory=Ears)
    frills: Frills = field(default_factory=Frills)
    teeth: Teeth = field(default_factory=Teeth)
    tongue: Tongue = field(default_factory=Tongue)
    template: Template = field(default_factory=Template)
    props: Props = field(default_factory=Props)
    controls: Controls = field(default_factory=Controls)
    limits: Limits = field(default_factory=Limits)
    acting: Acting = field(default_factory=Acting)


FOLDER = Path(__file__).parent.parent


def recipe_names() -> tuple[str, ...]:
    """Return the names of the recipes that come with the project."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.toml")))


def load_recipe(name_or_path: str | Path) -> Recipe:
    """Read and check a character's recipe.

    Args:
        name_or_path: the name of a recipe in `data_recipes/`, or the path of a TOML file.

    Raises:
        InputError: no such file, broken TOML, an unknown or missing key, or a value of the wrong type or out of range.
    """
    path = Path(name_or_path)
    if path.suffix != ".toml":
        path = FOLDER / f"{name_or_path}.toml"
        if not path.is_file():
            allowed = f"{', '.join(recipe_names())} or a .toml file"
            raise InputError(f"recipe {str(name_or_path)!r}: found no such character, allowed are {allowed}")
    recipe = _check(read_table(Recipe, read_toml(path), str(path), "", {"file": path.name}))
    return replace(recipe, clip_files=tuple(str(path.parent / name) for name in recipe.clip_files))


def read_toml(path: Path) -> dict:
    """Return a TOML file's table. Raises InputError for a missing file, bytes that are no text, and broken TOML."""
    try:
        return tomllib.loads(path.read_bytes().decode("utf-8"))
    except OSError as error:
        raise InputError(f"{path}: found no readable file ({error.strerror}), allowed is a recipe in TOML") from error
    except UnicodeDecodeError as error:
        found = f"bytes that are no UTF-8 at {error.start}"
        raise InputError(f"{path}: found {found}, allowed is a recipe in TOML") from error
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: found broken TOML ({error}), allowed is a recipe in TOML") from error


def read_table(kind: type, table: dict, file: str, prefix: str, given: dict) -> Any:
    """Build a dataclass from a TOML table, field by field; `given` are fields that don't come from it.

    kind: a dataclass whose fields say by their metadata what is allowed, as in `recipe_sections`. file, prefix: for
    messages. Raises InputError, naming file and key.
    """
    known = {spec.name: spec for spec in fields(kind) if spec.name not in given}
    for key in table:
        if key not in known:
            raise InputError(f"{file}: found unknown key '{prefix}{key}', allowed are {', '.join(known)}")
    values = dict(given)
    for key, spec in known.items():
        section = spec.default_factory
        if key not in table:
            if spec.default is MISSING and section is MISSING:
                raise InputError(f"{file}: found no key '{prefix}{key}', it is required")
        elif is_dataclass(section):
            if not isinstance(table[key], dict):
                raise InputError(f"{file}: '{prefix}{key}': found {table[key]!r}, allowed is a table [{key}]")
            values[key] = read_table(section, table[key], file, f"{prefix}{key}.", {})
        else:
            try:
                values[key] = _value(table[key], spec)
            except ValueError as error:
                raise InputError(f"{file}: '{prefix}{key}': found {table[key]!r}, allowed is {error}") from None
    return kind(**values)


def _value(found: Any, spec: Field) -> Any:
    """Return a value in its field's type. Raises ValueError, which says what is allowed, where it doesn't fit."""
    rule = spec.metadata
    kind = rule.get("kind")
    if kind is None:
        return _name(found) if spec.type == "str" else _whole(found, 1, None, False)
    if kind == "choice":
        if found not in rule["options"]:
            raise ValueError("one of " + ", ".join(rule["options"]))
        return found
    if kind == "groups":
        fits = isinstance(found, dict) and all(
            isinstance(parts, list) and all(part in PARTS for part in parts) for parts in found.values()
        )
        if not fits:
            raise ValueError("a table of lists of the parts " + ", ".join(PARTS))
        return {name: tuple(parts) for name, parts in found.items()}
    if kind == "names":
        if not isinstance(found, list) or not all(isinstance(item, str) and item for item in found):
            raise ValueError("a list of names")
        return tuple(found)
    if kind == "files":
        if not isinstance(found, list) or not all(isinstance(item, str) and item for item in found):
            raise ValueError("a list of paths of CSV files")
        return tuple(found)
    lower, upper = rule["range"]
    if kind == "number":
        return _number(found, lower, upper, f"a number from {lower:g} to {upper:g}")
    if kind == "count":
        return _whole(found, lower, upper, rule.get("even", False))
    if not isinstance(found, list) or not found:
        raise ValueError("a list")
    if kind == "span":
        allowed = f"two whole numbers from {lower} to {upper}, the smaller first"
        if len(found) != 2 or any(type(i) is not int or not lower <= i <= upper for i in found) or found[0] > found[1]:
            raise ValueError(allowed)
        return tuple(found)
    if kind == "table":
        allowed = f"rows of {rule['width']} numbers from {lower:g} to {upper:g}"
        if any(not isinstance(row, list) or len(row) != rule["width"] for row in found):
            raise ValueError(allowed)
        return tuple(tuple(_number(item, lower, upper, allowed) for item in row) for row in found)
    allowed = f"{rule.get('length', 'a list of')} numbers from {lower:g} to {upper:g}"
    if len(found) != rule.get("length", len(found)):
        raise ValueError(allowed)
    return tuple(_number(item, lower, upper, allowed) for item in found)


def _name(found: Any) -> str:
    if not isinstance(found, str) or not found.isidentifier():
        raise ValueError("a name of letters, digits and _")
    return found


def _number(found: Any, lower: float, upper: float, allowed: str) -> float:
    if isinstance(found, bool) or not isinstance(found, int | float) or not lower <= found <= upper:
        raise ValueError(allowed)
    return float(found)


def _whole(found: Any, lower: int, upper: int | None, even: bool) -> int:
    if type(found) is not int or found < lower or (upper is not None and found > upper) or (even and found % 2):
        reach = f"of {lower} or more" if upper is None else f"from {lower} to {upper}"
        raise ValueError(f"{'an even' if even else 'a whole'} number {reach}")
    return found


def _check(recipe: Recipe) -> Recipe:
    """Hold the rules between several keys."""
    t, teeth, tongue = recipe.template, recipe.teeth, recipe.tongue

    def hold(rule: bool, key: str, found: Any, allowed: str) -> None:
        if not rule:
            raise InputError(f"{recipe.file}: '{key}': found {found}, allowed is {allowed}")

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
    allowed = "above mouth_rows and below eye_rows, those below hair_row"
    hold(apart, "template.nostril_rows", list(t.nostril_rows), allowed)
    hold(t.hair_row < rows[-1], "template.hair_row", t.hair_row, f"below the last row, {rows[-1]:g}")
    hold(t.crown_across < half, "template.crown_across", t.crown_across, f"below half_columns = {half}")
    order = (t.eye_columns[1], t.face_columns, t.ear_columns[0] - 1, t.ear_columns[1])
    inside = all(a < b for a, b in pairwise(order)) and order[-1] <= t.coarse_from < half
    allowed = "eye_columns < face_columns < ear_columns - 1, ear_columns <= coarse_from < half_columns"
    hold(inside, "template.face_columns", t.face_columns, allowed)
    widest = max(t.mouth_columns, t.nostril_columns[1])
    hold(widest < t.face_columns, "template.mouth_columns", t.mouth_columns, f"below face_columns = {t.face_columns}")
    coarse = list(t.coarse_rows)
    hold((coarse[1] - coarse[0]) % 3 == 0, "template.coarse_rows", coarse, "a multiple of 3 rows apart")
    hold(t.lip_rings < t.mouth_rings, "template.lip_rings", t.lip_rings, f"below mouth_rings = {t.mouth_rings}")
    for side in ("upper", "lower"):
        widths, half_teeth = getattr(teeth, f"widths_{side}"), getattr(teeth, side) // 2
        allowed = f"a width for each of the {half_teeth} teeth of a half"
        hold(len(widths) >= half_teeth, f"teeth.widths_{side}", f"{len(widths)} widths", allowed)
        columns = getattr(tongue, f"gum_columns_{side}")
        hold(columns % 2 == 1, f"tongue.gum_columns_{side}", columns, "an odd number")
    hold(not (tongue.cap[0] % 2 or tongue.cap[1] % 2), "tongue.cap", list(tongue.cap), "two even numbers")
    pupil, iris = recipe.eyes.pupil_deg, recipe.eyes.iris_deg
    hold(pupil < iris, "eyes.pupil_deg", pupil, f"below iris_deg = {iris:g}")
    _check_segments(recipe.segments, hold)
    names = [Path(name).stem for name in recipe.clip_files]
    hold(len(set(names)) == len(names), "clip_files", list(recipe.clip_files), "files of different names")
    return recipe


def _check_segments(segments: dict[str, tuple[str, ...]], hold) -> None:
    used = [part for parts in segments.values() for part in parts]
    alone = set(PARTS) - set(used)
    for name, parts in segments.items():
        key = f"segments.{name}"
        hold(name.isidentifier() and name not in alone, key, repr(name), "a name that no other segment has")
        hold(len(parts) > 1, key, list(parts), "two or more parts")
        twice = [part for part in parts if used.count(part) > 1]
        hold(not twice, key, f"'{twice[0]}' again" if twice else "", "each part once")
        hold("face" not in parts, key, "the part 'face'", "any other: the face needs all of its chart")
