"""The neutral pose of a folder of samples as its file has it: an OBJ, read line by line, or a GLB.

An OBJ is read here, because general readers split vertices at the seams of charts or merge them, and the order of the
vertices is that of the poses.
"""

from __future__ import annotations

import io
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from replicate.base.exceptions import InputError
from replicate.base.schema import cut, shown
from replicate.base.user_files import read_bytes, read_text, shown_path

MOST_BYTES = 400_000_000
MOST_CORNERS = 64  # of a polygon
FAR = 1e9
NO_LABEL = ""


@dataclass(frozen=True)
class NeutralFile:
    """A mesh as its file has it, in its own unit and axes, cut into triangles.

    vertices: (n, 3). faces: (f, 3) vertex indices. uv: (u, 2) or None; uv_faces: (f, 3) indices into it. groups,
    materials: each face's, "" for none. members: the vertices that a group names itself, by point elements of an OBJ.
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

    Raises InputError, naming the line or the index, for what is no mesh: numbers that are none, faces of vertices that
    there are not, texture coordinates at some corners only, vertices in no face.
    """
    mesh = _read_obj(file) if file.suffix.lower() == ".obj" else _read_glb(file)
    where = shown_path(file)
    n = len(mesh.vertices)
    if not n or not len(mesh.faces):
        raise InputError(f"{where}: found {n} vertices and {len(mesh.faces)} faces: allowed is one of each at least")
    for name, array, limit in (("vertex", mesh.vertices, FAR), ("texture coordinate", mesh.uv, FAR)):
        bad = [] if array is None else np.flatnonzero(~(np.abs(array) <= limit).all(axis=1))
        if len(bad):
            value = shown(array[bad[0]].tolist())
            raise InputError(f"{where}: {name} {bad[0]} (from 0) is {value}: allowed are numbers up to {limit:g}")
    outside = np.flatnonzero(((mesh.faces < 0) | (mesh.faces >= n)).any(axis=1))
    if len(outside):
        raise InputError(
            f"{where}: face {outside[0]} names vertex {mesh.faces[outside[0]].max()}: allowed are 0 to {n - 1}"
        )
    unused = np.flatnonzero(np.bincount(mesh.faces.ravel(), minlength=n) == 0)
    if len(unused):
        raise InputError(f"{where}: vertex {unused[0]} (from 0) is in no face: allowed are vertices of faces alone")
    return mesh


def _read_obj(file: Path) -> NeutralFile:
    where = shown_path(file)
    vertices, uv, faces, uv_faces, groups, materials = [], [], [], [], [], []
    group = material = NO_LABEL
    corners_without, members = 0, {}
    for line, text in enumerate(read_text(file, MOST_BYTES).splitlines(), start=1):
        word, _, rest = text.strip().partition(" ")
        if word == "v":
            vertices.append(_numbers(rest, 3, f"{where}: line {line}"))
        elif word == "vt":
            uv.append(_numbers(rest, 2, f"{where}: line {line}"))
        elif word in ("g", "o"):
            group = rest.strip()
        elif word == "usemtl":
            material = rest.strip()
        elif word == "p":
            own = [_index(one, len(vertices), "vertex", f"{where}: line {line}") for one in rest.split("#")[0].split()]
            members.setdefault(group, []).extend(own)
        elif word == "f":
            own, own_uv = _polygon(rest, len(vertices), len(uv), f"{where}: line {line}")
            corners_without += own_uv is None
            for k in range(1, len(own) - 1):
                faces.append((own[0], own[k], own[k + 1]))
                uv_faces.append((0, 0, 0) if own_uv is None else (own_uv[0], own_uv[k], own_uv[k + 1]))
                groups.append(group)
                materials.append(material)
    has_uv = bool(faces) and not corners_without
    if corners_without and uv and any(map(any, uv_faces)):
        raise InputError(
            f"{where}: {corners_without} polygons have no texture coordinates and others have: allowed is all or none"
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


def _numbers(text: str, count: int, where: str) -> list[float]:
    try:
        values = [float(word) for word in text.split()[:count]]
    except ValueError:
        values = []
    if len(values) < count:
        raise InputError(f"{where} has {shown(text.strip())}: allowed are {count} numbers")
    return values


def _polygon(text: str, vertices: int, uvs: int, where: str) -> tuple[list[int], list[int] | None]:
    """Return a polygon's vertices and texture coordinates, from 0; None where it has none."""
    corners = [corner.split("/") for corner in text.split("#")[0].split()]
    if not 3 <= len(corners) <= MOST_CORNERS:
        raise InputError(f"{where} has a polygon of {len(corners)} corners: allowed are 3 to {MOST_CORNERS}")
    own = [_index(corner[0], vertices, "vertex", where) for corner in corners]
    if len(set(own)) < len(own):
        raise InputError(f"{where} has a polygon with a vertex twice: allowed is once")
    with_uv = [len(corner) > 1 and corner[1] != "" for corner in corners]
    if any(with_uv) and not all(with_uv):
        raise InputError(f"{where} has a polygon with texture coordinates at some corners: allowed is all or none")
    return own, [_index(corner[1], uvs, "texture coordinate", where) for corner in corners] if with_uv[0] else None


def _index(text: str, count: int, what: str, where: str) -> int:
    try:
        number = int(text) if len(text) < 12 else 0
    except ValueError:
        number = 0
    index = number - 1 if number > 0 else count + number
    if number == 0 or not 0 <= index < count:
        raise InputError(f"{where} names {what} {shown(text)}: allowed are whole numbers from 1 to {count}")
    return index


def _read_glb(file: Path) -> NeutralFile:
    """Read a GLB's triangles, the meshes of its scene one after the other, moved as its nodes say."""
    import trimesh  # not for those who bring an OBJ

    where, data = shown_path(file), read_bytes(file, MOST_BYTES)
    try:
        scene = trimesh.load(io.BytesIO(data), file_type="glb", force="scene", process=False)
        parts = [(*scene.graph[node], node) for node in scene.graph.nodes_geometry]
    except Exception as error:  # whatever its reader stumbles over
        raise InputError(f"{where}: found no readable GLB ({cut(' '.join(str(error).split()))})") from None
    vertices, faces, uv, groups, materials = [], [], [], [], []
    first = 0
    for transform, name, _ in parts:
        own = scene.geometry[name]
        if not isinstance(own, trimesh.Trimesh):
            raise InputError(f"{where}: {shown(name)} has no triangles: allowed are meshes of triangles alone")
        vertices.append(np.asarray(own.vertices, float) @ transform[:3, :3].T + transform[:3, 3])
        faces.append(np.asarray(own.faces, np.int64) + first)
        uv.append(getattr(own.visual, "uv", None))
        material = getattr(getattr(own.visual, "material", None), "name", None)
        groups += [str(name)] * len(own.faces)
        materials += [str(material or NO_LABEL)] * len(own.faces)
        first += len(own.vertices)
    without = sum(one is None or len(one) == 0 for one in uv)
    if 0 < without < len(uv):
        raise InputError(
            f"{where}: {without} of its {len(uv)} meshes have no texture coordinates: allowed is all or none"
        )
    every = np.concatenate([np.empty((0, 3), np.int64), *faces])
    return NeutralFile(
        np.concatenate([np.empty((0, 3)), *vertices]),
        every,
        np.concatenate([np.asarray(one, float) for one in uv]) if uv and not without else None,
        every if uv and not without else None,
        tuple(groups),
        tuple(materials),
    )
