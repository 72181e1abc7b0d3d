"""The neutral pose of a folder of samples as its file has it: an OBJ or PLY, read row by row, a GLB, a glTF or a USD.

General readers split or merge vertices at the seams of charts. Here they keep the order that the poses have too.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from data_recipes.gltf.document import buffer_files
from data_recipes.gltf.gltf_face import GltfFace, read_gltf
from data_recipes.sampled.point_caches import SPOKEN, Spoken, is_cache, mesh_of
from data_recipes.sampled.polygons import triangulate
from replicate.base.exceptions import InputError
from replicate.base.schema import cut, shown
from replicate.base.user_files import read_bytes, shown_path

MOST_BYTES = 400_000_000
FAR = 1e9
NO_LABEL = ""
NO_GROUP = (NO_LABEL, "default")  # names that an OBJ's faces have before anyone groups them
CONTINUED = ("v", "vt", "f", "p")  # lines of numbers


@dataclass(frozen=True)
class NeutralFile:
    """A mesh in the unit and axes of its file, cut into triangles.

    faces: vertex indices.
    uv_faces: indices into uv, −1 for the faces without texture coordinates.
    groups, materials: of each face, "" for none.
    members: group → the vertices that it lists itself, by point elements of an OBJ.
    remarks: sentences on what was left out.
    """

    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    uv: Float[np.ndarray, "u 2"] | None
    uv_faces: Int[np.ndarray, "f 3"] | None
    groups: tuple[str, ...]
    materials: tuple[str, ...]
    members: dict[str, list[int]] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    @property
    def unused(self) -> Int[np.ndarray, " k"]:
        """The vertices in no face."""
        return np.flatnonzero(np.bincount(self.faces.ravel(), minlength=len(self.vertices)) == 0)


def read_mesh(file: Path, spoken: Spoken = SPOKEN) -> NeutralFile:
    """Return a mesh file's content.

    spoken: the unit and axes that a USD, which states its own, is converted to; other files are taken to have them.
    Raises InputError, naming the line or the index, for texts in place of numbers and faces with vertices that don't
    exist.
    """
    mesh = _read_cache(file, spoken) if is_cache(file) else READERS[file.suffix.lower()](file)
    where = shown_path(file)
    n = len(mesh.vertices)
    if not n or not len(mesh.faces):
        raise InputError(f"{where}: expected vertices and faces, got {n} vertices and {len(mesh.faces)} faces")
    _check_numbers(mesh.vertices, "vertex", where)
    if mesh.uv is not None:
        _check_numbers(mesh.uv, "texture coordinate", where)
    outside = np.flatnonzero(((mesh.faces < 0) | (mesh.faces >= n)).any(axis=1))
    if len(outside):
        vertex = mesh.faces[outside[0]].max()
        raise InputError(f"{where}: face {outside[0]}: expected vertices from 0 to {n - 1}, got {vertex}")
    if unused := len(mesh.unused):
        mesh = replace(mesh, remarks=(*mesh.remarks, f"{where}: vertices in no face, which stand still: {unused}"))
    return mesh


def _check_numbers(rows: Float[np.ndarray, "k d"], what: str, where: str) -> None:
    bad = np.flatnonzero(~(np.abs(rows) <= FAR).all(axis=1))  # NaN as well
    if len(bad):
        value = shown(rows[bad[0]].tolist())
        raise InputError(f"{where}: {what} {bad[0]} (from 0): expected numbers up to {FAR:g}, got {value}")


def buffers_of(file: Path) -> tuple[Path, ...]:
    """Return the files that a mesh file's content is in besides itself: buffers of a glTF."""
    return buffer_files(file) if file.suffix.lower() == ".gltf" else ()


def _read_obj(file: Path) -> NeutralFile:
    where = shown_path(file)
    vertices, uv, polygons, uv_polygons, labels = [], [], [], [], []
    item = group = material = NO_LABEL
    members = {}
    for line, (word, *words) in _lines(_text(file)):
        place = f"{where}: line {line}"
        if word == "v":
            vertices.append(_coordinates(words, 3, place))
        elif word == "vt":
            uv.append(_coordinates(words, 2, place))
        elif word == "o":
            item = group = " ".join(words)
        elif word == "g":
            name = " ".join(words)
            group = item or name if name in NO_GROUP else name
        elif word == "usemtl":
            material = " ".join(words)
        elif word == "p":
            points = [_index(point, len(vertices), "vertex", place) for point in _before_comment(words)]
            members.setdefault(group, []).extend(points)
        elif word == "f":
            corners, uv_corners = _polygon(_before_comment(words), len(vertices), len(uv), place)
            polygons.append(corners)
            uv_polygons.append(uv_corners)
            labels.append((group, material))
    return _of_polygons(where, vertices, uv, polygons, uv_polygons, labels, members)


def _of_polygons(
    where: str,
    vertices: Sequence,
    uv: Sequence,
    polygons: Sequence[list[int]],
    uv_polygons: Sequence[list[int]],
    labels: Sequence[tuple[str, str]],
    members: dict[str, list[int]],
) -> NeutralFile:
    """Return a mesh of polygons that may repeat corners or vertices; labels: the group and material of each."""
    cleaned = [_without_repeats(*both) for both in zip(polygons, uv_polygons, strict=True)]
    kept = [k for k, (corners, _) in enumerate(cleaned) if len(set(corners)) >= 3]
    points = np.array(vertices, np.float64).reshape(-1, 3)
    _check_numbers(points, "vertex", where)
    triangles = triangulate(points, [cleaned[k][0] for k in kept])
    uv_faces = np.array([corner for k in kept for corner in cleaned[k][1]], np.int64)[triangles.corner]
    has_uv = bool((uv_faces >= 0).any())
    left_out = {
        "of fewer than 3 different vertices": len(cleaned) - len(kept),
        "of the same vertices as another": triangles.repeated,
    }
    of_face = [labels[kept[k]] for k in triangles.polygon]
    return NeutralFile(
        points,
        triangles.faces,
        np.array(uv, np.float64).reshape(-1, 2) if has_uv else None,
        uv_faces if has_uv else None,
        tuple(group for group, _ in of_face),
        tuple(material for _, material in of_face),
        members,
        tuple(f"{where}: polygons {kind}, left out: {count}" for kind, count in left_out.items() if count),
    )


def _without_repeats(corners: list[int], uv: list[int]) -> tuple[list[int], list[int]]:
    """Return a polygon and its texture coordinates without the corners that the next one repeats."""
    if len(set(corners)) == len(corners):
        return corners, uv
    kept = [k for k, vertex in enumerate(corners) if vertex != corners[(k + 1) % len(corners)]]
    return [corners[k] for k in kept], [uv[k] for k in kept]


def _text(file: Path) -> str:
    """Return a file's text. Names that aren't UTF-8 are read as Windows writes them in Europe and America."""
    data = read_bytes(file, MOST_BYTES)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def _lines(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the number and the words of each line with any; a line of numbers that ends in a backslash goes on."""
    first, words = 0, []
    for number, line in enumerate(io.StringIO(text, newline=None), start=1):
        first = number if not words else first
        words += line.split()
        if words and words[-1].endswith("\\") and words[0] in CONTINUED:
            words[-1:] = [words[-1][:-1]] if len(words[-1]) > 1 else []
            continue
        if words:
            yield first, words
        words = []
    if words:
        yield first, words


def _before_comment(words: list[str]) -> list[str]:
    return words[: next((k for k, word in enumerate(words) if word.startswith("#")), len(words))]


def _coordinates(words: list[str], count: int, where: str) -> list[float]:
    try:
        values = [float(word) for word in words[:count]]
    except ValueError:
        values = []
    if len(values) < count or not all(abs(value) <= FAR for value in values):  # False for NaN as well
        raise InputError(f"{where}: expected {count} numbers up to {FAR:g}, got {shown(' '.join(words))}")
    return values


def _polygon(words: list[str], vertices: int, uvs: int, where: str) -> tuple[list[int], list[int]]:
    """Return the indices, from 0, of a polygon's vertices and of their texture coordinates, −1 if any has none."""
    corners = [corner.split("/") for corner in words]
    if len(corners) < 3:
        raise InputError(f"{where}: expected a polygon of 3 corners or more, got {len(corners)}")
    polygon = [_index(corner[0], vertices, "vertex", where) for corner in corners]
    if all(len(corner) > 1 and corner[1] for corner in corners):
        uv = [_index(corner[1], uvs, "texture coordinate", where) for corner in corners]
    else:
        uv = [-1] * len(polygon)
    return polygon, uv


def _index(text: str, count: int, kind: str, where: str) -> int:
    """Return an index from 0 for one of an OBJ, which counts from 1, and backwards from −1."""
    try:
        stated = int(text) if len(text) < 12 else 0
    except ValueError:
        stated = 0
    index = stated - 1 if stated > 0 else count + stated
    if stated == 0 or not 0 <= index < count:
        raise InputError(f"{where}: {kind}: expected a whole number from 1 to {count}, got {shown(text)}")
    return index


UV_NAMES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))


def _read_ply(file: Path) -> NeutralFile:
    """Read a PLY, which has no groups; its texture coordinates are those of vertices, or of the corners of faces."""
    where, data = shown_path(file), read_bytes(file, MOST_BYTES)
    try:
        elements = read_ply(data)
    except ValueError as error:
        raise InputError(f"{where}: not a readable PLY ({cut(str(error))})") from None
    vertex, face = elements.get("vertex", {}), elements.get("face", {})
    polygons = [list(corners) for corners in face.get("vertex_indices", face.get("vertex_index", ()))]
    if missing := [name for name in "xyz" if name not in vertex]:
        raise InputError(f"{where}: its vertices have no {missing[0]}")
    points = list(zip(*(vertex[name] for name in "xyz"), strict=True))
    _check_corners(polygons, len(points), where)
    names = next((names for names in UV_NAMES if set(names) <= vertex.keys()), None)
    if names:
        uv, uv_polygons = list(zip(*(vertex[name] for name in names), strict=True)), polygons
    else:
        uv, uv_polygons = _uv_of_corners(polygons, face.get("texcoord", [()] * len(polygons)))
    return _of_polygons(where, points, uv, polygons, uv_polygons, [(NO_LABEL, NO_LABEL)] * len(polygons), {})


def _check_corners(polygons: Sequence[list], count: int, where: str) -> None:
    for k, corners in enumerate(polygons):
        if not all(isinstance(corner, int) and 0 <= corner < count for corner in corners):
            raise InputError(f"{where}: face {k} (from 0): expected vertices from 0 to {count - 1}, got {corners}")


def _uv_of_corners(polygons: list[list[int]], texcoord: Sequence[tuple]) -> tuple[list[tuple], list[list[int]]]:
    """Return different places, and which of them each corner has; u and v of each corner follow one another."""
    places, found = {}, []
    for corners, values in zip(polygons, texcoord, strict=True):
        if len(values) == 2 * len(corners):
            pairs = zip(values[::2], values[1::2], strict=True)
            found.append(
                [places.setdefault((vertex, *pair), len(places)) for vertex, pair in zip(corners, pairs, strict=True)]
            )
        else:
            found.append([-1] * len(corners))
    return [place[1:] for place in places], found


def neutral_of(face: GltfFace) -> NeutralFile:
    """Return a glTF's triangles, in file order; its nodes are the groups."""
    uv_faces = None if face.uv is None else np.where(face.has_uv[face.faces], face.faces, -1)
    return NeutralFile(face.vertices, face.faces, face.uv, uv_faces, face.nodes, face.materials)


def _read_gltf(file: Path) -> NeutralFile:
    return neutral_of(read_gltf(file))


def _read_cache(file: Path, spoken: Spoken) -> NeutralFile:
    found = mesh_of(file, spoken)
    where, points = shown_path(file), found.vertices
    _check_corners(found.polygons, len(points), where)
    mesh = _of_polygons(
        where, points.tolist(), found.uv, found.polygons, found.uv_polygons, found.labels, found.members
    )
    return replace(mesh, remarks=(*found.remarks, *mesh.remarks))


READERS = {".obj": _read_obj, ".ply": _read_ply, ".glb": _read_gltf, ".gltf": _read_gltf}


# PLY files, in text or binary: elements with their properties, in the order of the file.

TYPES = {
    **dict.fromkeys(("char", "int8"), "b"),
    **dict.fromkeys(("uchar", "uint8"), "B"),
    **dict.fromkeys(("short", "int16"), "h"),
    **dict.fromkeys(("ushort", "uint16"), "H"),
    **dict.fromkeys(("int", "int32"), "i"),
    **dict.fromkeys(("uint", "uint32"), "I"),
    **dict.fromkeys(("float", "float32"), "f"),
    **dict.fromkeys(("double", "float64"), "d"),
}
FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
LONGEST_HEADER = 100_000  # bytes

Properties = dict[str, list]  # name → a value a row: a number, or a tuple of numbers for a list


@dataclass
class _Element:
    count: int
    properties: dict[str, tuple[str, ...]] = field(default_factory=dict)  # name → (type,), or (type of length, type)


def read_ply(data: bytes) -> dict[str, Properties]:
    """Return the elements of a PLY file by name. Raises ValueError, with the reason, for anything else."""
    order, elements, body = _header(data)
    read = _words(body) if order == "" else _binary(body, order)
    found = {}
    for name, element in elements.items():
        rows = list(_rows(element, read))
        columns = zip(*rows, strict=True) if rows else ((),) * len(element.properties)
        found[name] = dict(zip(element.properties, map(list, columns), strict=True))
    return found


def _header(data: bytes) -> tuple[str, dict[str, _Element], bytes]:
    """Return the order of bytes ("" for text), the elements that are to come, and what follows the header."""
    end = data.find(b"end_header", 0, LONGEST_HEADER)
    if not data.startswith(b"ply") or end < 0:
        raise ValueError("it has no header of a PLY")
    after = data[end + len(b"end_header") :]
    body = after[2:] if after.startswith(b"\r\n") else after[1:]
    order, elements, last = None, {}, None
    for line in data[:end].decode("ascii", errors="replace").splitlines()[1:]:
        match line.split():
            case ["format", name, _] if name in FORMATS:
                order = FORMATS[name]
            case ["element", name, count] if count.isdecimal():
                elements[name] = last = _Element(int(count))
            case ["property", "list", of_length, kind, name] if last and {of_length, kind} <= TYPES.keys():
                last.properties[name] = (TYPES[of_length], TYPES[kind])
            case ["property", kind, name] if last and kind in TYPES:
                last.properties[name] = (TYPES[kind],)
            case [] | ["comment" | "obj_info", *_]:
                pass
            case _:
                raise ValueError(f"its header says {line.strip()!r}")
    if order is None:
        raise ValueError("its header states no format")
    return order, elements, body


Read = Callable[[str, int], tuple]  # the types of values to come, how many times → the values


def _rows(element: _Element, read: Read) -> Iterator[list]:
    """Yield the values of each row of an element. Runs of single values are read at once."""
    types = list(element.properties.values())
    if not types:
        return
    if all(len(kind) == 1 for kind in types):
        together = "".join(kind for (kind,) in types)
        for _ in range(element.count):
            yield list(read(together, 1))
        return
    for _ in range(element.count):
        row = []
        for kind in types:
            first = read(kind[0], 1)[0]
            row.append(first if len(kind) == 1 else read(kind[1], _length(first)))
        yield row


def _length(stated: float) -> int:
    if stated < 0 or stated != int(stated):
        raise ValueError(f"a list has the length {stated}")
    return int(stated)


def _words(body: bytes) -> Read:
    words, at = body.split(), 0

    def read(types: str, times: int) -> tuple:
        nonlocal at
        count = len(types) * times
        if at + count > len(words):
            raise ValueError("it ends too early")
        taken, at = words[at : at + count], at + count
        return tuple(
            float(word) if kind in "fd" else int(word) for word, kind in zip(taken, types * times, strict=True)
        )

    return read


def _binary(body: bytes, order: str) -> Read:
    at = 0

    def read(types: str, times: int) -> tuple:
        nonlocal at
        size = struct.calcsize(order + types) * times
        if at + size > len(body):
            raise ValueError("it ends too early")
        start, at = at, at + size
        return struct.unpack_from(order + types * times, body, start)

    return read
