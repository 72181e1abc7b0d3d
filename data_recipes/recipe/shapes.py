"""The recipe of a face of shapes: what a `face.toml` beside its file may say, all of it optional."""
# ruff: noqa: RUF009 — defaults are `dataclasses.field`s, or frozen

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from data_recipes.acting.procedural_acting import Acting
from data_recipes.recipe_paths import FACE_FILE, shape_file
from data_recipes.sampled.face_file import FARTHEST_LIMIT, Points, check_words, read_words
from replicate.base.exceptions import InputError
from replicate.base.schema import Checked, names, number, numbers, shown
from replicate.base.user_files import is_file

AXES = ("x", "y", "z")
GUESS = "guess"
FARTHEST_DEG = 180.0


@dataclass(frozen=True)
class ShapeFace(Checked):
    """What may be said of such a face, in a `face.toml` beside it: all of it is optional.

    name: "" for that of the file.
    unit: "guess" takes the one that makes it as large as a face.
    up: the axis that points upwards; a glTF's is always y.
    segments: what makes a segment of the mesh: a node or an OBJ's group, a material, or an island of the texture.
    keep: parts that no control moves and that are approximated all the same.
    rigid: names of segments that move rigidly; () has the poses show which do.
    limits: control → its least and its greatest value; 0 and 1 otherwise.
    joints: joint of the skin → axis (x, y, z, its own at rest) → least and greatest angle, degrees; each is a control.
    eyes: the middle between the eyeballs, in the file's unit and axes; () has it guessed.
    acting: the animation that is invented for it.
    mesh: of a folder, the file of the neutral; "" for the one that is called so.
    """

    name: str = ""
    unit: Literal["guess", "mm", "cm", "dm", "m", "in", "ft"] = GUESS
    up: Literal["y", "z"] = "y"
    segments: Literal["groups", "materials", "islands"] = "groups"
    keep: tuple[str, ...] = names(what="parts")
    rigid: tuple[str, ...] = names(what="segments")
    limits: dict = field(default_factory=dict)
    joints: dict = field(default_factory=dict)
    frames_per_second: float = number(24.0, 1.0, 1_000.0)
    source: str = ""
    licence: str = ""
    eyes: tuple[float, ...] = numbers((), 3, -1e6, 1e6, optional=True)
    points: Points = Points()
    acting: Acting = Acting(seed=1, clips=40)
    mesh: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_words(self.name or "unnamed", self.source, self.licence)
        for name, limits in self.limits.items():
            _check_span(f"limits.{shown(name)}", limits, FARTHEST_LIMIT, "least and greatest value")
        for joint, axes in self.joints.items():
            if not isinstance(axes, dict) or not axes or not set(axes) <= set(AXES):
                raise InputError(f"joints.{shown(joint)}: expected limits of x, y or z, got {shown(axes)}")
            for axis, limits in axes.items():
                _check_span(f"joints.{shown(joint)}.{axis}", limits, FARTHEST_DEG, "least and greatest angle")


def _check_span(key: str, limits: object, farthest: float, what: str) -> None:
    fits = isinstance(limits, (list, tuple)) and len(limits) == 2
    fits = fits and all(isinstance(x, (int, float)) and not isinstance(x, bool) and abs(x) <= farthest for x in limits)
    if not (fits and limits[0] <= 0 <= limits[1] and limits[0] < limits[1]):
        raise InputError(f"{key}: expected {what} around 0, such as [0, 1], got {shown(limits)}")


@dataclass(frozen=True)
class ShapeRecipe:
    """What a rig of shapes is made from besides its files. name: the character's. file: where it lies; "" in keys."""

    name: str
    face: ShapeFace
    file: str = ""


def load_shape_recipe(character: str) -> ShapeRecipe:
    """Return what is said of a face of shapes; raise InputError, naming file and key, for a `face.toml` that is wrong.

    character: the path of a glTF, or of a folder with a mesh, or a pose of samples, for each shape.
    """
    place = shape_file(character)
    folder = place if place.is_dir() else place.parent
    toml = folder / FACE_FILE
    face = read_words(ShapeFace, toml) if is_file(toml) else ShapeFace()
    return ShapeRecipe(face.name or (place.name if place.is_dir() else place.stem), face, str(place))
