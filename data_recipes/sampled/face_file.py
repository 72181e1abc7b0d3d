"""What `face.toml` says of a folder of samples: name, unit, axes, segments, and where the eyes and the points are."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float

from data_recipes.controls import Control
from data_recipes.sampled.shards import DAMAGE
from replicate.base.exceptions import InputError
from replicate.base.schema import Checked, either, identifier, naming, number, numbers, read_table, shown
from replicate.base.user_files import read_text, read_toml, shown_path

FACE_FILE = "face.toml"
MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
MESH_ENDINGS = (".obj", ".ply", ".glb")
FAR = 1e6  # the farthest place of the eyes, in the file's unit
LONGEST_TEXT = 500  # characters of a source or licence
MOST_POINTS = 100
LANDMARKS_AT_LEAST = 3


@dataclass(frozen=True)
class Points(Checked):
    """Vertices by index, from 0: landmarks that samples are balanced by, control points that inverse kinematics drags.

    control_points: region → vertices. A rule chooses whatever is empty.
    """

    landmarks: tuple[int, ...] = field(default=(), metadata={"range": (0, None), "optional": True})
    control_points: dict = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.landmarks and not LANDMARKS_AT_LEAST <= len(self.landmarks) <= MOST_POINTS:
            raise InputError(
                f"landmarks: expected {LANDMARKS_AT_LEAST} to {MOST_POINTS} vertices, got {len(self.landmarks)}"
            )
        for region, vertices in self.control_points.items():
            if not region.isprintable() or not _is_list_of_vertices(vertices):
                expected = f"expected 1 to {MOST_POINTS} different vertices for each region"
                raise InputError(f"control_points.{shown(region)}: {expected}, got {shown(vertices)}")
        all_points = [vertex for vertices in self.control_points.values() for vertex in vertices]
        for name, indices in (("landmarks", list(self.landmarks)), ("control_points", all_points)):
            twice = [vertex for vertex in indices if indices.count(vertex) > 1]
            if twice:
                raise InputError(f"{name}: vertex {twice[0]} is there twice, expected once")
        # lists as tuples, so that what is stored and read again is equal
        as_tuples = {region: tuple(vertices) for region, vertices in self.control_points.items()}
        object.__setattr__(self, "control_points", as_tuples)


def _is_list_of_vertices(value: Any) -> bool:
    return (
        isinstance(value, (list, tuple))
        and 0 < len(value) <= MOST_POINTS
        and all(isinstance(item, int) and not isinstance(item, bool) and 0 <= item < 2**31 for item in value)
    )


@dataclass(frozen=True)
class FaceFile(Checked):
    """A folder's `face.toml`.

    unit, up: of the mesh and of the poses.
    mesh: a file of the folder.
    segments: what makes a segment of the mesh.
    eyes: the middle between the eyeballs, in the file's unit and axes; () has it guessed from the face's size.
    """

    name: str = identifier()
    unit: Literal["mm", "cm", "m", "in"] = field()
    up: Literal["y", "z"] = field()
    mesh: str = field()
    segments: Literal["groups", "materials", "islands"] = field()
    frames_per_second: float = number(24.0, 1.0, 1_000.0)
    source: str = ""
    licence: str = ""
    eyes: tuple[float, ...] = numbers((), 3, -FAR, FAR, optional=True)
    points: Points = Points()

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.mesh != Path(self.mesh).name or Path(self.mesh).suffix.lower() not in MESH_ENDINGS:
            raise InputError(
                f"mesh: expected the name of a {either(MESH_ENDINGS)} file in this folder, got {shown(self.mesh)}: "
                "export the neutral pose as one of these, its vertices in the order of the poses"
            )
        for name in ("source", "licence"):
            text = getattr(self, name)
            if not (text.isprintable() and len(text) <= LONGEST_TEXT):
                expected = f"expected one line of at most {LONGEST_TEXT} characters"
                raise InputError(f"{name}: {expected}, got {shown(text)}")

    @property
    def mm(self) -> float:
        """The unit in millimetres."""
        return MM[self.unit]

    def to_ours(self, points: Float[np.ndarray, "*b 3"]) -> Float[np.ndarray, "*b 3"]:
        """Return points of the files in mm and in our axes (y up, z forwards), without moving them."""
        if self.up == "z":  # the face looks along -y
            points = np.stack([points[..., 0], points[..., 2], -points[..., 1]], axis=-1)
        return points * self.mm


def read_face(folder: Path) -> FaceFile:
    """Return what a folder's `face.toml` says. Raises InputError, naming file and key, for a wrong or missing value."""
    file = folder / FACE_FILE
    table = read_toml(file)
    with naming(shown_path(file)):
        return read_table(FaceFile, table)


# The controls of a folder of samples, `controls.csv`: a line for each control, in the order of the columns of `params`.

CONTROL_FILE = "controls.csv"
HEADER = ["name", "lower", "default", "upper", "region"]
MOST_BYTES = 4_000_000
MOST_CONTROLS = 5_000
LONGEST_NAME = 63  # bytes
FARTHEST_LIMIT = 1e9  # beyond it a limit is a mistake
WITHOUT_REGION = "face"


def read_controls(folder: Path) -> tuple[Control, ...]:
    """Return the controls. Raises InputError, naming file, line and control, for a table that is wrong."""
    file = folder / CONTROL_FILE
    where = shown_path(file)
    reader = csv.reader(io.StringIO(read_text(file, MOST_BYTES), newline=""), strict=True)
    controls: dict[str, Control] = {}
    try:
        header = next(reader, [])
        if header != HEADER:
            raise InputError(f"{where}: line 1: expected {','.join(HEADER)}, got {shown(','.join(header))}")
        for row in reader:
            if not row:
                continue
            control = _control(row, f"{where}: line {reader.line_num}")
            if control.name in controls:
                raise InputError(f"{where}: line {reader.line_num} names the control {shown(control.name)} again")
            controls[control.name] = control
            if len(controls) > MOST_CONTROLS:
                raise InputError(f"{where}: expected at most {MOST_CONTROLS:,} controls, got more")
    except csv.Error as error:
        raise InputError(f"{where}: expected CSV text, but it can't be read ({error})") from None
    if not controls:
        raise InputError(f"{where}: expected at least one control, got none")
    return tuple(controls.values())


def _control(row: list[str], where: str) -> Control:
    if len(row) != len(HEADER):
        raise InputError(f"{where}: expected {len(HEADER)} values, {','.join(HEADER)}, got {len(row)}")
    name, *texts, region = (cell.strip() for cell in row)
    for text, column, least in ((name, "name", 1), (region, "region", 0)):
        if not (text.isprintable() and least <= len(text.encode()) <= LONGEST_NAME and "," not in text):
            expected = f"expected a printable text of {least} to {LONGEST_NAME} bytes without commas"
            raise InputError(f"{where}: {column}: {expected}, got {shown(text)}")
    values = []
    for text, column in zip(texts, HEADER[1:4], strict=True):
        try:
            values.append(float(text))
        except ValueError:
            values.append(np.nan)
        if not abs(values[-1]) <= FARTHEST_LIMIT:  # False for NaN as well
            expected = f"expected a number up to {FARTHEST_LIMIT:g}"
            raise InputError(f"{where}: {column} of {shown(name)}: {expected}, got {shown(text)}")
    with naming(where):
        return Control(name, *values, region or WITHOUT_REGION)


# The optional `influence.npy` of a folder of samples: which control moves which vertex.

INFLUENCE_FILE = "influence.npy"


def influence_file(folder: Path) -> tuple[Path, ...]:
    """Return the folder's `influence.npy` as a tuple of one, or () where there is none."""
    file = folder / INFLUENCE_FILE
    return (file,) if file.exists() or file.is_symlink() else ()


def read_influence(file: Path, vertices: int, controls: int) -> Bool[np.ndarray, "n m"]:
    """Return which control (a column) moves which vertex (a row). Raises InputError for a file that is anything else.

    A single control may move nothing; not all of them.
    """
    where = shown_path(file)
    if not file.is_file():
        raise InputError(f"{where} is no regular file: write an array of true and false, or remove it")
    try:
        moves = np.load(file, mmap_mode="r", allow_pickle=False)
    except (*DAMAGE, OverflowError, MemoryError) as error:
        raise InputError(f"{where}: not a readable npy file ({error})".replace("\n", " ")) from None
    if not isinstance(moves, np.ndarray) or moves.dtype != bool or moves.shape != (vertices, controls):
        found = f"{moves.dtype} {moves.shape}" if isinstance(moves, np.ndarray) else "several arrays"
        expected = f"expected true or false (bool) for every vertex and control, ({vertices}, {controls})"
        raise InputError(f"{where}: {expected}, got {found}")
    if not moves.any():
        raise InputError(f"{where}: no control moves a vertex: let at least one do so, or remove the file")
    return np.array(moves)
