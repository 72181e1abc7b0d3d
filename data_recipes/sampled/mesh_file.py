"""The neutral pose of a folder of samples as its file has it: an OBJ, read line by line, a GLB or a glTF.

General OBJ readers split or merge vertices at the seams of charts. Here they keep the order that the poses have too.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from data_recipes.gltf.document import buffer_files
from data_recipes.gltf.gltf_face import read_gltf
from replicate.base.exceptions import InputError
from replicate.base.schema import shown
from replicate.base.user_files import read_text, shown_path

MOST_BYTES = 400_000_000
MOST_CORNERS = 64  # of a polygon
FAR = 1e9
NO_LABEL = ""


@dataclass(frozen=True)
class NeutralFile:
    """A mesh in the unit and axes of its file, cut into triangles.

    faces: vertex indices.
    uv_faces: indices into uv.
    groups, materials: of each face, "" for none.
    members: group → the vertices that it lists itself, by point elements of an OBJ.
    """

    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "f 3"]
    uv: Float[np.ndarray, "u 2"] | None
    uv_faces: Int[np.ndarray, "f 3"] | None
    groups: tuple[str, ...]
    materials: tuple[str, ...]
    members: dict[str, list[int]] = field(default_factory=dict)


def read_mesh(file: Path) -> NeutralFile:
    """Return a mesh file's content.

    Raises InputError, naming the line or the index, for texts in place of numbers, faces with vertices that don't
    exist, texture coordinates at some corners only, and vertices without a face.
    """
    mesh = _read_obj(file) if file.suffix.lower() == ".obj" else _read_gltf(file)
    where = shown_path(file)
    n = len(mesh.vertices)
    if not n or not len(mesh.faces):
        raise InputError(f"{where}: expected vertices and faces, got {n} vertices and {len(mesh.faces)} faces")
    for name, array, limit in (("vertex", mesh.vertices, FAR), ("texture coordinate", mesh.uv, FAR)):
        bad = [] if array is None else np.flatnonzero(~(np.abs(array) <= limit).all(axis=1))
        if len(bad):
            value = shown(array[bad[0]].tolist())
            raise InputError(f"{where}: {name} {bad[0]} (from 0): expected numbers up to {limit:g}, got {value}")
    outside = np.flatnonzero(((mesh.faces < 0) | (mesh.faces >= n)).any(axis=1))
    if len(outside):
        vertex = mesh.faces[outside[0]].max()
        raise InputError(f"{where}: face {outside[0]}: expected vertices from 0 to {n - 1}, got {vertex}")
    unused = np.flatnonzero(np.bincount(mesh.faces.ravel(), minlength=n) == 0)
    if len(unused):
        raise InputError(f"{where}: vertex {unused[0]} (from 0) is in no face: remove it from mesh and poses")
    return mesh


def buffers_of(file: Path) -> tuple[Path, ...]:
    """Return the files that a mesh file's content is in besides itself: buffers of a glTF."""
    return buffer_files(file) if file.suffix.lower() == ".gltf" else ()


def _read_obj(file: Path) -> NeutralFile:
    where = shown_path(file)
    vertices, uv, faces, uv_faces, groups, materials = [], [], [], [], [], []
    group = material = NO_LABEL
    polygons_without_uv, members = 0, {}
    for line, text in enumerate(read_text(file, MOST_BYTES).splitlines(), start=1):
        place = f"{where}: line {line}"
        word, _, rest = text.strip().partition(" ")
        if word == "v":
            vertices.append(_coordinates(rest, 3, place))
        elif word == "vt":
            uv.append(_coordinates(rest, 2, place))
        elif word in ("g", "o"):
            group = rest.strip()
        elif word == "usemtl":
            material = rest.strip()
        elif word == "p":
            points = [_index(point, len(vertices), "vertex", place) for point in rest.split("#")[0].split()]
            members.setdefault(group, []).extend(points)
        elif word == "f":
            corners, uv_corners = _polygon(rest, len(vertices), len(uv), place)
            polygons_without_uv += uv_corners is None
            uv_corners = uv_corners or [0] * len(corners)
            for k in range(1, len(corners) - 1):
                faces.append((corners[0], corners[k], corners[k + 1]))
                uv_faces.append((uv_corners[0], uv_corners[k], uv_corners[k + 1]))
                groups.append(group)
                materials.append(material)
    has_uv = bool(faces) and not polygons_without_uv
    if polygons_without_uv and uv and any(map(any, uv_faces)):
        raise InputError(
            f"{where}: {polygons_without_uv} polygons have no texture coordinates and others have: give them to all "
            "polygons or to none"
        )
    return NeutralFile(
        np.array(vertices, np.float64).reshape(-1, 3),
        np.array(faces, np.int64).reshape(-1, 3),
        np.array(uv, np.float64).reshape(-1, 2) if has_uv else None,
        np.array(uv_faces, np.int64).reshape(-1, 3) if has_uv else None,
        tuple(groups),
        tuple(materials),
        members,
    )


def _coordinates(text: str, count: int, where: str) -> list[float]:
    try:
        values = [float(word) for word in text.split()[:count]]
    except ValueError:
        values = []
    if len(values) < count:
        raise InputError(f"{where}: expected {count} numbers, got {shown(text.strip())}")
    return values


def _polygon(text: str, vertices: int, uvs: int, where: str) -> tuple[list[int], list[int] | None]:
    """Return the indices, from 0, of a polygon's vertices and of their texture coordinates (None without any)."""
    corners = [corner.split("/") for corner in text.split("#")[0].split()]
    if not 3 <= len(corners) <= MOST_CORNERS:
        raise InputError(f"{where}: expected a polygon of 3 to {MOST_CORNERS} corners, got {len(corners)}")
    polygon = [_index(corner[0], vertices, "vertex", where) for corner in corners]
    if len(set(polygon)) < len(polygon):
        raise InputError(f"{where}: the polygon has a vertex twice, expected once")
    with_uv = [len(corner) > 1 and corner[1] != "" for corner in corners]
    if any(with_uv) and not all(with_uv):
        raise InputError(
            f"{where}: the polygon has texture coordinates at some corners: give them to all corners or to none"
        )
    return polygon, [_index(corner[1], uvs, "texture coordinate", where) for corner in corners] if with_uv[0] else None


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


def _read_gltf(file: Path) -> NeutralFile:
    """Read the triangles of a GLB's or glTF's scene, in file order; its nodes are the groups."""
    face = read_gltf(file)
    if face.uv is not None and not face.has_uv.all():
        without = list(dict.fromkeys(np.array(face.nodes)[~face.has_uv[face.faces[:, 0]]]))
        raise InputError(
            f"{shown_path(file)}: {shown(', '.join(without))}: no texture coordinates, and other parts have some: give "
            "them to all parts or to none"
        )
    uv_faces = None if face.uv is None else face.faces
    return NeutralFile(face.vertices, face.faces, face.uv, uv_faces, face.nodes, face.materials)
