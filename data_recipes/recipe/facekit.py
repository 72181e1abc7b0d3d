"""The recipe of a face in ICT-FaceKit's format: the vertices of its parts, and the few numbers that we add to it."""
# ruff: noqa: RUF009 — defaults are `dataclasses.field`s, or frozen

from dataclasses import dataclass, fields
from typing import Literal

from data_recipes.acting.procedural_acting import Acting
from data_recipes.recipe.character import VERTICES_MOST
from data_recipes.recipe.sections import Wrinkles
from replicate.base.exceptions import InputError
from replicate.base.schema import Checked, identifier, names, number, span


@dataclass(frozen=True)
class Parts(Checked):
    """First and last vertex of each part; eyeballs are only shown in pictures."""

    face: tuple[int, ...] = span(lower=0, upper=VERTICES_MOST)
    head: tuple[int, ...] = span(lower=0, upper=VERTICES_MOST)
    mouth: tuple[int, ...] = span(lower=0, upper=VERTICES_MOST)
    eye_socket_left: tuple[int, ...] = span(lower=0, upper=VERTICES_MOST)
    eye_socket_right: tuple[int, ...] = span(lower=0, upper=VERTICES_MOST)
    gums_tongue: tuple[int, ...] = span(lower=0, upper=VERTICES_MOST)
    teeth: tuple[int, ...] = span(lower=0, upper=VERTICES_MOST)
    eyeball_left: tuple[int, ...] = span(lower=0, upper=VERTICES_MOST)
    eyeball_right: tuple[int, ...] = span(lower=0, upper=VERTICES_MOST)


@dataclass(frozen=True)
class Reach(Checked):
    """How far expressions go past their full shapes when Eq. 5 multiplies them, as multiples of the full shape.

    closing: of the controls that close lids and lips; these meet at 1, and far beyond it would pass through each other.
    vertex: of a vertex's sum over all expressions, as a multiple of the farthest that one expression carries it.
    """

    control: float = number(1.25, 1.02, 2.0)
    closing: float = number(1.04, 1.02, 2.0)
    vertex: float = number(1.6, 1.1, 4.0)


@dataclass(frozen=True)
class Folds(Checked):
    """The wrinkles: each region's gain, and how many of the mesh's rows make a fold of the forehead."""

    forehead: float = number(1.0, 0.0, 4.0)
    glabella: float = number(1.0, 0.0, 4.0)
    crow: float = number(1.0, 0.0, 4.0)
    nasolabial: float = number(1.0, 0.0, 4.0)
    rows: int = number(4, 2, 12)


@dataclass(frozen=True)
class FaceKitRecipe(Checked):
    """A character read from a folder in ICT-FaceKit's format.

    vertices: of the model, whose version they tell.
    clip_files: as in `recipe.character`.
    """

    name: str = identifier()
    vertices: int = number(lower=1, upper=VERTICES_MOST)
    parts: Parts
    model: Literal["ict_facekit"] = "ict_facekit"
    file: str = "<memory>"
    clip_files: tuple[str, ...] = names(what="paths of CSV files")
    reach: Reach = Reach()
    folds: Folds = Folds()
    wrinkles: Wrinkles = Wrinkles()
    acting: Acting = Acting()


def check_parts(recipe: FaceKitRecipe) -> None:
    """Raise InputError, naming the key, for a part whose last vertex the model doesn't have."""
    for part in fields(recipe.parts):
        first, last = getattr(recipe.parts, part.name)
        if last >= recipe.vertices:
            expected = f"expected two of the model's vertices, 0 to {recipe.vertices - 1}"
            raise InputError(f"parts.{part.name}: {expected}, got {[first, last]}")
