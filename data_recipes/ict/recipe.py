"""The recipe of a face in ICT-FaceKit's format: which vertices are what, and the few numbers that we add to it."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from pathlib import Path

from data_recipes.acting.procedural_acting import Acting
from data_recipes.recipe.reading import read_table, read_toml
from data_recipes.recipe_paths import recipe_file
from replicate.engine.exceptions import InputError

MODEL = "ict_facekit"


def _number(default: float, lower: float, upper: float):
    return field(default=default, metadata={"kind": "number", "range": (lower, upper)})


def _count(default: int, lower: int, upper: int):
    return field(default=default, metadata={"kind": "count", "range": (lower, upper), "even": False})


def _part():
    """First and last vertex; all parts are required."""
    return field(metadata={"kind": "span", "range": (0, 10**7)})


@dataclass(frozen=True)
class Parts:
    """First and last vertex of each part; eyeballs are shown in pictures and not approximated."""

    face: tuple[int, ...] = _part()
    head: tuple[int, ...] = _part()
    mouth: tuple[int, ...] = _part()
    eye_socket_left: tuple[int, ...] = _part()
    eye_socket_right: tuple[int, ...] = _part()
    gums_tongue: tuple[int, ...] = _part()
    teeth: tuple[int, ...] = _part()
    eyeball_left: tuple[int, ...] = _part()
    eyeball_right: tuple[int, ...] = _part()


@dataclass(frozen=True)
class Reach:
    """How far expressions go past their full shapes when Eq. 5 multiplies them, in units of the full shape."""

    control: float = _number(1.25, 1.02, 2.0)
    # Lids and lips that meet at 1 would pass through each other beyond it.
    closing: float = _number(1.04, 1.02, 2.0)
    # Of a vertex's sum over all expressions, against the farthest that one of them carries it.
    vertex: float = _number(1.6, 1.1, 4.0)


@dataclass(frozen=True)
class Folds:
    """The wrinkles: each region's gain, and how many of the mesh's rows make a fold of the forehead."""

    forehead: float = _number(1.0, 0.0, 4.0)
    glabella: float = _number(1.0, 0.0, 4.0)
    crow: float = _number(1.0, 0.0, 4.0)
    nasolabial: float = _number(1.0, 0.0, 4.0)
    rows: int = _count(4, 2, 12)


@dataclass(frozen=True)
class FaceKitRecipe:
    """A character read from a folder in ICT-FaceKit's format.

    vertices: of the model, by which its version is known. clip_files: as in `recipe.Recipe`. parts has no default.
    """

    name: str
    model: str = field(metadata={"kind": "choice", "options": (MODEL,)})
    vertices: int
    file: str = "<memory>"
    clip_files: tuple[str, ...] = field(default=(), metadata={"kind": "files"})
    parts: Parts = field(default_factory=Parts)
    reach: Reach = field(default_factory=Reach)
    folds: Folds = field(default_factory=Folds)
    acting: Acting = field(default_factory=Acting)


def is_facekit(name_or_recipe: str | Path) -> bool:
    """Tell whether a recipe asks for a model in ICT-FaceKit's format; False for one that can't be read."""
    try:
        return "model" in read_toml(recipe_file(str(name_or_recipe)))
    except InputError:
        return False


def load_recipe(name_or_recipe: str | Path) -> FaceKitRecipe:
    """Read and check such a recipe. Raises InputError, naming file and key."""
    path = recipe_file(str(name_or_recipe))
    table = read_toml(path)
    if not isinstance(table.get("parts"), dict):
        raise InputError(f"{path}: found no table [parts], it is required")
    recipe = read_table(FaceKitRecipe, table, str(path), "", {"file": path.name})
    for part in fields(recipe.parts):
        last = getattr(recipe.parts, part.name)[1]
        if last >= recipe.vertices:
            allowed = f"vertices from 0 to {recipe.vertices - 1} are allowed"
            raise InputError(f"{path}: 'parts.{part.name}': found the last vertex {last}, where {allowed}")
    return replace(recipe, clip_files=tuple(str(path.parent / name) for name in recipe.clip_files))
