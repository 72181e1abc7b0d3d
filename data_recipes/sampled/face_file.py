"""What `face.toml` says of a folder of samples: name, unit, axes, segments, and where the eyes and the points are."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from jaxtyping import Bool, Float

from data_recipes.landmark_set import FACE_LANDMARKS
from data_recipes.sampled.shards import CACHE_ENDINGS, DAMAGE
from replicate.base.exceptions import InputError
from replicate.base.schema import LONGEST, Checked, either, names, naming, number, numbers, read_table, shown
from replicate.base.spelling import nothing_named
from replicate.base.user_files import read_text, read_toml, shown_path

FACE_FILE, CONTROL_FILE = "face.toml", "controls.csv"
MESH_ENDINGS = (".obj", ".ply", ".glb", ".gltf", *CACHE_ENDINGS)  # of the neutral
STATING = (".usd", ".usda", ".usdc")  # of files that state their unit and axes
MM = {"mm": 1.0, "cm": 10.0, "dm": 100.0, "m": 1000.0, "in": 25.4, "ft": 304.8}
FAR = 1e6  # the farthest place of the eyes, in the file's unit
LONGEST_TEXT = 500  # characters of a source or licence
MOST_POINTS = 100
LANDMARKS_AT_LEAST = 3


@dataclass(frozen=True)
class Points(Checked):
    """Vertices by index, from 0: landmarks that samples are balanced by, control points that inverse kinematics drags.

    control_points: region → vertices. A rule chooses whatever is empty.
    face_landmarks: name, of `FACE_LANDMARKS`, → vertex of the mesh's file; performance capture needs all of them, and
        finds those that a face of shapes leaves out.
    """

    landmarks: tuple[int, ...] = field(default=(), metadata={"range": (0, None), "optional": True})
    control_points: dict = field(default_factory=dict)
    face_landmarks: dict = field(default_factory=dict)

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
        for name, vertex in self.face_landmarks.items():
            if name not in FACE_LANDMARKS:
                others = f"; there are {', '.join(FACE_LANDMARKS)}"
                raise InputError(f"face_landmarks: {nothing_named('landmark', name, FACE_LANDMARKS, others)}")
            if not _is_list_of_vertices([vertex]):
                raise InputError(f"face_landmarks.{name}: expected a vertex, from 0, got {shown(vertex)}")
        all_points = [vertex for vertices in self.control_points.values() for vertex in vertices]
        marks = list(self.face_landmarks.values())
        lists = (("landmarks", list(self.landmarks)), ("control_points", all_points), ("face_landmarks", marks))
        for name, indices in lists:
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
    rigid: names of segments that move rigidly; () has the poses show which do.
    eyes: the middle between the eyeballs, in the file's unit and axes; () has it guessed from the face's size.
    """

    name: str = field()
    unit: Literal["mm", "cm", "dm", "m", "in", "ft"] = field()
    up: Literal["y", "z"] = field()
    mesh: str = field()
    segments: Literal["groups", "materials", "islands"] = "groups"
    frames_per_second: float = number(24.0, 1.0, 1_000.0)
    source: str = ""
    licence: str = ""
    eyes: tuple[float, ...] = numbers((), 3, -FAR, FAR, optional=True)
    rigid: tuple[str, ...] = names(what="segments")
    points: Points = Points()

    @property
    def states_unit(self) -> bool:
        """Whether the mesh's file states its unit and axes itself, as a USD does."""
        return self.mesh.lower().endswith(STATING)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_words(self.name, self.source, self.licence)
        if self.mesh != Path(self.mesh).name or Path(self.mesh).suffix.lower() not in MESH_ENDINGS:
            raise InputError(
                f"mesh: expected the name of a {either(MESH_ENDINGS)} file in this folder, got {shown(self.mesh)}: "
                "export the neutral pose as one of these, its vertices in the order of the poses"
            )

    @property
    def mm(self) -> float:
        """The unit in millimetres."""
        return MM[self.unit]

    def to_ours(self, points: Float[np.ndarray, "*b 3"]) -> Float[np.ndarray, "*b 3"]:
        """Return points of the files in mm and in our axes (y up, z forwards), without moving them."""
        return in_our_axes(points, self.up) * self.mm


def check_words(name: str, source: str, licence: str) -> None:
    """Raise InputError for a name that no file could have, and for texts of more than a line."""
    if not re.fullmatch(r"\w[\w-]*", name) or len(name.encode()) > LONGEST:
        raise InputError(f"name: expected at most {LONGEST} letters, digits, _ and -, got {shown(name)}")
    for key, text in (("source", source), ("licence", licence)):
        if not (text.isprintable() and len(text) <= LONGEST_TEXT):
            expected = f"expected one line of at most {LONGEST_TEXT} characters"
            raise InputError(f"{key}: {expected}, got {shown(text)}")


def in_our_axes(points: Float[np.ndarray, "*b 3"], up: str) -> Float[np.ndarray, "*b 3"]:
    """Return points with y up and z forwards; where z is up, a face looks along -y."""
    return np.stack([points[..., 0], points[..., 2], -points[..., 1]], axis=-1) if up == "z" else points


def read_face(folder: Path) -> FaceFile:
    """Return what a folder's `face.toml` says. Raises InputError, naming file and key, for a wrong or missing value."""
    return read_words(FaceFile, folder / FACE_FILE)


Said = TypeVar("Said", bound=Checked)


def read_words(kind: type[Said], file: Path) -> Said:
    """Return what a `face.toml` of some kind says, "CM" for "cm" included. Raises InputError as `read_face` does."""
    table = read_toml(file)
    for key in ("unit", "up", "segments"):
        if isinstance(table.get(key), str):
            table[key] = table[key].lower()
    with naming(shown_path(file)):
        return read_table(kind, table)


# The controls of a folder of samples, `controls.csv`: a line for each control, in the order of the columns of `params`.

HEADER = ["name", "lower", "default", "upper", "region"]
MOST_BYTES = 4_000_000
MOST_CONTROLS = 5_000
LONGEST_NAME, LONGEST_REGION = 200, 63  # bytes
FARTHEST_LIMIT = 1e9  # beyond it a limit is a mistake
WITHOUT_REGION = "face"


@dataclass(frozen=True)
class ControlLine:
    """A line of `controls.csv`. lower, upper: NaN where the line leaves them to the poses."""

    name: str
    lower: float
    default: float
    upper: float
    region: str


def read_controls(folder: Path) -> tuple[ControlLine, ...]:
    """Return the controls. Raises InputError, naming file, line and control, for a table that is wrong.

    Cells may be separated by commas, semicolons or tabs, whichever the header has most of; where it isn't by commas,
    numbers may have one in the place of a point.
    """
    file = folder / CONTROL_FILE
    where = shown_path(file)
    text = read_text(file, MOST_BYTES)
    separator = max(",;\t", key=re.split(r"[\r\n]", text, maxsplit=1)[0].count)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, skipinitialspace=True, strict=True)
    lines: dict[str, ControlLine] = {}
    try:
        header = _without_empty_end(next(reader, []), 0)
        names = [name.lower() for name in header]
        if sorted(names) not in (sorted(HEADER), sorted(HEADER[:-1])):
            raise InputError(f"{where}: line 1: expected {','.join(HEADER)}, got {shown(','.join(header))}")
        for row in reader:
            cells = _without_empty_end(row, len(names))
            if not any(cells):
                continue
            place = f"{where}: line {reader.line_num}"
            if len(cells) != len(names):
                raise InputError(f"{place}: expected {len(names)} values, {','.join(names)}, got {len(cells)}")
            line = _control_line(dict(zip(names, cells, strict=True)), separator != ",", place)
            if line.name in lines:
                raise InputError(f"{place} names the control {shown(line.name)} again")
            lines[line.name] = line
            if len(lines) > MOST_CONTROLS:
                raise InputError(f"{where}: expected at most {MOST_CONTROLS:,} controls, got more")
    except csv.Error as error:
        raise InputError(f"{where}: expected CSV text, but it can't be read ({error})") from None
    if not lines:
        raise InputError(f"{where}: expected at least one control, got none")
    return tuple(lines.values())


def _without_empty_end(row: list[str], width: int) -> list[str]:
    """Return a row's cells, bare, without the empty ones that spreadsheets put behind the first `width`."""
    cells = [cell.strip() for cell in row]
    while len(cells) > width and not cells[-1]:
        cells.pop()
    return cells


def _control_line(cells: dict[str, str], decimal_commas: bool, where: str) -> ControlLine:
    name, region = cells["name"], cells.get("region", "")
    for text, column, least, most in ((name, "name", 1, LONGEST_NAME), (region, "region", 0, LONGEST_REGION)):
        if not (text.isprintable() and least <= len(text.encode()) <= most):
            raise InputError(
                f"{where}: {column}: expected a printable text of {least} to {most} bytes, got {shown(text)}"
            )
    lower, default, upper = (
        _limit(cells[column], column != "default", decimal_commas, f"{where}: {column} of {shown(name)}")
        for column in HEADER[1:4]
    )
    if lower > upper:  # False for NaN
        raise InputError(f"{where}: {shown(name)}: expected lower below upper, got {lower:g} and {upper:g}")
    if default < lower or default > upper:
        reach = f"from {lower:g} " * (not np.isnan(lower)) + f"up to {upper:g}" * (not np.isnan(upper))
        raise InputError(f"{where}: {shown(name)}: expected a default {reach.strip()}, got {default:g}")
    return ControlLine(name, lower, default, upper, region or WITHOUT_REGION)


def _limit(text: str, may_be_missing: bool, decimal_commas: bool, where: str) -> float:
    """Return a number; NaN for a limit that is empty or infinite."""
    if may_be_missing and re.fullmatch(r"|[+-]?inf(inity)?", text, re.IGNORECASE):
        return np.nan
    try:
        value = float(text.replace(",", ".") if decimal_commas else text)
    except ValueError:
        value = np.nan
    if not abs(value) <= FARTHEST_LIMIT:  # False for NaN as well
        raise InputError(f"{where}: expected a number up to {FARTHEST_LIMIT:g}, got {shown(text)}")
    return value


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
