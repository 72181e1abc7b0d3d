"""Which vertices, texture coordinates and rig parameters each network sees (§3.1, §3.2)."""

import json
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Int

from replicate.base.exceptions import InputError
from replicate.geometry.mesh import Mesh


@dataclass(frozen=True)
class Segment:
    """A set of vertices that one network deforms.

    vertices: (k,) int32, ascending indices into the mesh.
    uv: (k, 2) float32 in [0, 1], their places in the map, U_k.
    parameters: (j,) int32, indices of the rig parameters that can move one of them; at least one.
    """

    name: str
    vertices: np.ndarray
    uv: np.ndarray
    parameters: np.ndarray


def make_segment(name: str, vertices: np.ndarray, uv: np.ndarray, influence: Bool[np.ndarray, "n m"]) -> Segment:
    """Return a segment that sees the parameters that move any of its vertices (§3.1), or all of them if none does."""
    moves = influence[vertices].any(0)
    parameters = np.flatnonzero(moves) if moves.any() else np.arange(influence.shape[1])
    return Segment(name, vertices.astype(np.int32), np.ascontiguousarray(uv, np.float32), parameters.astype(np.int32))


def whole_mesh(mesh: Mesh, parameters: int) -> Segment:
    """Return all vertices as one segment that sees every rig parameter, for methods that divide nothing."""
    every = np.ones((len(mesh.neutral), parameters), bool)
    return make_segment("mesh", np.arange(len(mesh.neutral)), mesh.uv, every)


def coarse_segments(
    mesh: Mesh, rigid_segments: Collection[int], influence: Bool[np.ndarray, "n m"]
) -> tuple[Segment, ...]:
    """Return the mesh's segments without the rigid ones, in the mesh's order.

    rigid_segments: indices into `mesh.segment_names` (§3.4).
    influence: which parameter can move which vertex.

    Raises InputError if the influence is that of another mesh, or if every segment is rigid.
    """
    if len(influence) != len(mesh.neutral):
        raise InputError(f"influence: expected {len(mesh.neutral)} vertices, as the mesh has, got {len(influence)}")
    deforming = [k for k in range(len(mesh.segment_names)) if k not in set(rigid_segments)]
    if not deforming:
        raise InputError(f"mesh: expected a segment that deforms, got {len(mesh.segment_names)} rigid ones")
    vertices = [np.flatnonzero(mesh.segment == k) for k in deforming]
    names = [mesh.segment_names[k] for k in deforming]
    return tuple(make_segment(name, v, mesh.uv[v], influence) for name, v in zip(names, vertices, strict=True))


def segment_vertices(segments: Sequence[Segment]) -> Int[np.ndarray, " v"]:
    """Return the vertices of all segments, one segment after the other: the order of the networks' outputs."""
    return np.concatenate([segment.vertices for segment in segments])


def faces_within(faces: Int[np.ndarray, "f 3"], vertices: Int[np.ndarray, " v"], count: int) -> Int[np.ndarray, "g 3"]:
    """Return the faces all of whose corners are among `vertices`, as positions in `vertices`.

    count: n, the number of the mesh's vertices.
    """
    place = np.full(count, -1, np.int32)
    place[vertices] = np.arange(len(vertices), dtype=np.int32)
    corners = place[faces]
    return corners[(corners >= 0).all(1)]


def faces_touching(
    faces: Int[np.ndarray, "f 3"], vertices: Int[np.ndarray, " v"], count: int
) -> Bool[np.ndarray, " f"]:
    """Return which faces have a corner among `vertices`."""
    inside = np.zeros(count, bool)
    inside[vertices] = True
    return inside[faces].any(1)


def save_segments(segments: Sequence[Segment], file: Path) -> None:
    """Write segments as one npz file."""
    fields = ("vertices", "uv", "parameters")
    arrays = {f"{k}.{field}": getattr(segment, field) for k, segment in enumerate(segments) for field in fields}
    names = json.dumps([segment.name for segment in segments])
    np.savez(file, names=np.frombuffer(names.encode(), np.uint8), **arrays)


def load_segments(file: Path) -> tuple[Segment, ...]:
    """Read what `save_segments` wrote."""
    with np.load(file, allow_pickle=False) as arrays:
        names = json.loads(bytes(arrays["names"]))
        fields = ("vertices", "uv", "parameters")
        return tuple(Segment(name, *(arrays[f"{k}.{field}"] for field in fields)) for k, name in enumerate(names))
