"""Reading ICT-FaceKit's files: a neutral OBJ with polygons and charts, an OBJ for each expression, indices in JSON.

The format is plain Wavefront OBJ. General readers split or merge vertices at the charts' seams; the one here keeps
every index, for each means something in this model.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from replicate.base.exceptions import InputError
from replicate.base.paths import named_folder
from replicate.base.schema import cut, shown
from replicate.base.user_files import is_file, read_text, shown_path

VARIABLE = "ICT_FACEKIT"
SOURCE = "ICT-FaceKit by USC ICT on GitHub, ICT-FaceKit/FaceXModel"
NEUTRAL, INDICES = "generic_neutral_mesh.obj", "vertex_indices.json"
MOST_BYTES = 100_000_000  # of one file; the model's largest has 4 MB
MOST_CORNERS = 64  # of a polygon; the model has quads and triangles, and a chart of large ones can't be laid out
MM = 10.0  # the model is in centimetres
LANDMARKS = 68  # Multi-PIE's markup
WIDEST_MM, NARROWEST_MM = 2000.0, 60.0  # a bust in another unit than the centimetre is wider or narrower


@dataclass(frozen=True)
class FaceKit:
    """A model as its files give it, in mm.

    polygons: vertex indices, −1 in the last place of a triangle.
    uv_polygons: the same for `uv`.
    offsets: from the neutral, by expression.
    landmarks: 68 vertices in Multi-PIE's order.
    """

    vertices: Float[np.ndarray, "n 3"]
    polygons: Int[np.ndarray, "q 4"]
    uv: Float[np.ndarray, "t 2"]
    uv_polygons: Int[np.ndarray, "q 4"]
    offsets: dict[str, Float[np.ndarray, "n 3"]]
    landmarks: Int[np.ndarray, " l"]


def model_folder() -> Path:
    """Return the folder of the model's files: `$ICT_FACEKIT` itself or its FaceXModel.

    Raises InputError when the variable is not set or names no folder with a neutral mesh.
    """
    folder = named_folder(VARIABLE)
    if folder is None:
        raise InputError(
            f"the character needs a folder that is not part of this project ({SOURCE}): get it and name it, as in "
            f"{VARIABLE}=/path/to/ICT-FaceKit"
        )
    for candidate in (folder, folder / "FaceXModel"):
        if is_file(candidate / NEUTRAL):
            return candidate
    raise InputError(f"{VARIABLE}={folder}: there is no {NEUTRAL}, expected the folder of {SOURCE}")


def model_files() -> tuple[Path, ...]:
    """Return all files to read: the indices, the neutral, and the expressions in the order of the indices.

    Raises InputError for a missing one.
    """
    folder = model_folder()
    files = (folder / INDICES, folder / NEUTRAL, *(folder / f"{name}.obj" for name in expression_names()))
    for file in files:
        if not is_file(file):
            raise InputError(
                f"{shown_path(file)}: there is no such file, though {INDICES} lists it: get a complete {SOURCE}"
            )
    return files


def expression_names() -> tuple[str, ...]:
    """Return the names of the model's expressions. Raises InputError as `model_files` does."""
    return tuple(_indices(model_folder() / INDICES)["expressions"])


def read_model(vertices: int) -> FaceKit:
    """Read the model, which must have so many vertices.

    Raises InputError, naming the file, for one that is missing, broken or of another version.
    """
    indices_file, neutral_file, *expression_files = model_files()
    indices = _indices(indices_file)
    rest, uv, polygons, uv_polygons = read_obj(neutral_file)
    if len(rest) != vertices:
        raise InputError(f"{neutral_file}: expected the {vertices} vertices of {SOURCE}, got {len(rest)}")
    width = MM * np.ptp(rest[:, 0])
    if not NARROWEST_MM < width < WIDEST_MM:
        raise InputError(
            f"{neutral_file}: expected a model {NARROWEST_MM:g} to {WIDEST_MM:g} mm wide, got {width:g} mm; its unit "
            "is taken to be the centimetre"
        )
    offsets = {}
    for file in expression_files:
        expression = read_vertices(file)
        if len(expression) != len(rest):
            raise InputError(f"{file}: expected the {len(rest)} vertices of {NEUTRAL}, got {len(expression)}")
        offsets[file.stem] = MM * (expression - rest)
    landmarks = indices["idx_to_landmark_verts"]
    bad = [index for index in landmarks if not 0 <= index < len(rest)]
    if len(landmarks) != LANDMARKS or bad:
        found = f"{len(landmarks)} landmarks" if len(landmarks) != LANDMARKS else f"vertex {shown(bad[0])}"
        expected = f"expected {LANDMARKS} landmarks, vertices from 0 to {len(rest) - 1}"
        raise InputError(f"{indices_file}: 'idx_to_landmark_verts': {expected}, got {found}")
    return FaceKit(MM * rest, polygons, uv, uv_polygons, offsets, np.array(landmarks, np.int64))


def _indices(file: Path) -> dict[str, list]:
    text = read_text(file, MOST_BYTES)
    try:
        table = json.loads(text)
        names, landmarks = table["expressions"], table["idx_to_landmark_verts"]
        if not isinstance(names, list) or not all(isinstance(name, str) and name.isidentifier() for name in names):
            raise TypeError("its expressions are no list of names")
        if not names or len(set(names)) < len(names):
            raise TypeError("it has no expressions, or one twice")
        if not isinstance(landmarks, list) or not all(type(index) is int for index in landmarks):
            raise TypeError("its idx_to_landmark_verts are no list of vertices")
        return {"expressions": names, "idx_to_landmark_verts": landmarks}
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        reason = cut(str(error))
        raise InputError(f"{file}: not a readable table of indices ({reason}), expected that of {SOURCE}") from error


def _coordinates(text: str, kind: str, width: int, file: Path) -> Float[np.ndarray, "n w"]:
    """Return the first `width` numbers of every line that begins with `kind`."""
    rows = re.findall(rf"^{kind}[ \t]+(.+)$", text, re.MULTILINE)
    try:  # all lines have equally many numbers; some exporters add colours or a third coordinate
        values = np.array(" ".join(rows).split(), np.float64).reshape(len(rows), -1)[:, :width]
        if values.shape[1] < width:
            raise ValueError
    except ValueError as error:
        raise InputError(f"{file}: expected lines '{kind}' with {width} numbers each, got others or none") from error
    if not len(rows) or not np.isfinite(values).all():
        raise InputError(f"{file}: expected lines '{kind}' with finite numbers, got {len(rows)} lines")
    return values


def read_vertices(file: Path) -> Float[np.ndarray, "n 3"]:
    """Return the vertices of an OBJ in the unit of the file. Raises InputError, naming it, when there are none."""
    return _coordinates(read_text(file, MOST_BYTES), "v", 3, file)


def read_obj(file: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return vertices (n, 3), texture coordinates (t, 2), polygons and their texture polygons, both (q, 4).

    A triangle has −1 in the last place; a polygon of more than four corners becomes a fan of triangles. A vertex keeps
    its index, however many texture coordinates its polygons give it. Raises InputError, naming file and line, for
    faces without texture coordinates or with indices out of range.
    """
    text = read_text(file, MOST_BYTES)
    vertices, uv = _coordinates(text, "v", 3, file), _coordinates(text, "vt", 2, file)
    corners: list[list[tuple[int, int]]] = []
    for line_number, line in enumerate(text.splitlines(), 1):
        if not line.startswith("f "):
            continue
        try:
            polygon = [_corner(word, len(vertices), len(uv)) for word in line.split()[1:]]
        except (ValueError, IndexError):
            polygon = []
        if not 3 <= len(polygon) <= MOST_CORNERS or len(set(polygon)) < len(polygon):
            raise InputError(
                f"{file}: line {line_number}: expected a face of 3 to {MOST_CORNERS} different corners v/vt within "
                f"{len(vertices)} vertices and {len(uv)} texture coordinates, got {shown(line.strip())}"
            )
        fans = [polygon] if len(polygon) <= 4 else [[polygon[0], *pair] for pair in pairwise(polygon[1:])]
        corners += [fan + [(-1, -1)] * (4 - len(fan)) for fan in fans]
    if not corners:
        raise InputError(f"{file}: expected faces, got none")
    table = np.array(corners, np.int64)
    return vertices, uv, table[:, :, 0], table[:, :, 1]


def _corner(word: str, vertices: int, coordinates: int) -> tuple[int, int]:
    """Return a corner's indices from 0; OBJ counts from 1, and backwards from −1."""
    index = []
    for text, count in zip(word.split("/")[:2], (vertices, coordinates), strict=True):
        value = int(text)
        value = value - 1 if value > 0 else count + value
        if not 0 <= value < count:
            raise IndexError(word)
        index.append(value)
    return index[0], index[1]
