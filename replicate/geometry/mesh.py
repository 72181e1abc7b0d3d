"""A triangle mesh with segments and their charts (§3).

A mesh's topology doesn't change with the pose: a character has one `Mesh`, and posed vertices are plain arrays
(..., n, 3) beside it.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from replicate.base.exceptions import InputError


@dataclass(frozen=True)
class Mesh:
    """A neutral mesh V⁰ with its segments (§3) and one chart per segment.

    neutral: (n, 3) float32, millimetres, x to the picture's right, y up, z forward.
    faces: (f, 3) int32, vertex indices, counter-clockwise from outside.
    uv: (n, 2) float32 in [0, 1], each vertex's place in its segment's chart.
    segment: (n,) int32, indices into `segment_names`.
    segment_names: one for each segment; every segment has a vertex.

    Raises InputError, naming the first offending index, for anything else.
    """

    # plain arrays: __post_init__ checks users' shapes, with better messages than type errors
    neutral: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    segment: np.ndarray
    segment_names: tuple[str, ...]

    def __post_init__(self) -> None:
        for name, dtype in (("neutral", np.float32), ("uv", np.float32), ("faces", np.int32), ("segment", np.int32)):
            object.__setattr__(self, name, _array(name, getattr(self, name), dtype))
        object.__setattr__(self, "segment_names", tuple(self.segment_names))
        _check_shapes(self)
        _check_values(self)

    @property
    def face_segment(self) -> Int[np.ndarray, " f"]:
        """The segment of each face: that of two of its corners, or of the first if all three differ."""
        a, b, c = self.segment[self.faces].T
        return np.where(b == c, b, a).astype(np.int32)

    def save(self, file: Path) -> None:
        """Write the mesh as npz, without pickle; the same mesh gives the same bytes."""
        arrays = {name: getattr(self, name) for name in ("neutral", "faces", "uv", "segment")}
        np.savez(file, **arrays, segment_names=np.array(self.segment_names))

    @classmethod
    def load(cls, file: Path) -> "Mesh":
        """Read what `save` wrote, and check it again."""
        with np.load(file, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in ("neutral", "faces", "uv", "segment")}
            return cls(**arrays, segment_names=tuple(stored["segment_names"].tolist()))


def _array(name: str, values, dtype) -> np.ndarray:
    array = np.asarray(values)
    kinds = "f" if dtype == np.float32 else "iu"
    if array.dtype.kind not in kinds:
        kind = "floating-point numbers" if kinds == "f" else "integers"
        raise InputError(f"mesh: {name}: expected {kind}, got {array.dtype}")
    return np.ascontiguousarray(array, dtype=dtype)


def _check_shapes(mesh: Mesh) -> None:
    n = len(mesh.neutral)
    shapes = {"neutral": (n, 3), "faces": (len(mesh.faces), 3), "uv": (n, 2), "segment": (n,)}
    for name, expectation in shapes.items():
        shape = getattr(mesh, name).shape
        if shape != expectation:
            raise InputError(f"mesh: {name}: expected the shape {expectation}, got {shape}")
    if n == 0 or len(mesh.faces) == 0:
        raise InputError(f"mesh: expected at least one vertex and one face, got {n} and {len(mesh.faces)}")


def _check_values(mesh: Mesh) -> None:
    n, segments = len(mesh.neutral), len(mesh.segment_names)
    if (i := _first(~np.isfinite(mesh.neutral).all(-1))) is not None:
        raise InputError(f"mesh: neutral[{i}]: expected finite millimetres, got {mesh.neutral[i].tolist()}")
    inside = (mesh.uv >= 0) & (mesh.uv <= 1)  # False for NaN as well
    if (i := _first(~inside.all(-1))) is not None:
        raise InputError(f"mesh: uv[{i}]: expected values in [0, 1], got {mesh.uv[i].tolist()}")
    if (i := _first(((mesh.faces < 0) | (mesh.faces >= n)).any(-1))) is not None:
        raise InputError(f"mesh: faces[{i}]: expected vertex indices from 0 to {n - 1}, got {mesh.faces[i].tolist()}")
    if (i := _first((mesh.segment < 0) | (mesh.segment >= segments))) is not None:
        raise InputError(
            f"mesh: vertex {i} is in no segment: segment[{i}]: expected 0 to {segments - 1}, got {mesh.segment[i]}"
        )
    if (i := _first(np.bincount(mesh.segment, minlength=segments) == 0)) is not None:
        raise InputError(f"mesh: segment {i} ({mesh.segment_names[i]!r}): expected at least one vertex, got none")
    if (i := _first(degenerate_faces(mesh.neutral, mesh.faces))) is not None:
        raise InputError(
            f"mesh: faces[{i}]: expected a face with an area, got {mesh.faces[i].tolist()}, whose corners coincide or "
            "lie on a line in the neutral pose"
        )


def _first(bad: np.ndarray) -> int | None:
    hits = np.flatnonzero(bad)
    return int(hits[0]) if len(hits) else None


# Normals of faces and vertices (n_i of Eq. 1 and Eq. 11), and faces that have none.

# A face is degenerate if its height, in lengths of its longest edge, is below this: float32 millimetres of a head have
# about 1e-5 mm of rounding, so the normal of such a face would be noise.
FLATNESS = 1e-5


def face_vectors(vertices: Float[np.ndarray, "*b n 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "*b f 3"]:
    """Return twice the area of each face times its normal: the cross product of two edges, not normalised."""
    a, b, c = (np.take(vertices, faces[:, k], axis=-2) for k in range(3))
    b -= a
    c -= a
    out = np.empty_like(b)
    out[..., 0] = b[..., 1] * c[..., 2] - b[..., 2] * c[..., 1]
    out[..., 1] = b[..., 2] * c[..., 0] - b[..., 0] * c[..., 2]
    out[..., 2] = b[..., 0] * c[..., 1] - b[..., 1] * c[..., 0]
    return out


def face_normals(vertices: Float[np.ndarray, "*b n 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "*b f 3"]:
    """Return each face's unit normal (n_i of Eq. 1 and Eq. 11), the zero vector for a face without area."""
    return _normalise(face_vectors(vertices, faces))


def vertex_normals(vertices: Float[np.ndarray, "*b n 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "*b n 3"]:
    """Return each vertex's unit normal: the mean of its faces' normals, weighted by area (for shading only)."""
    vectors = face_vectors(vertices, faces)
    total = np.zeros_like(vertices)
    flat, source = (total.reshape(-1, *total.shape[-2:]), vectors.reshape(-1, *vectors.shape[-2:]))
    for pose, vector in zip(flat, source, strict=True):
        for corner in range(3):
            for axis in range(3):
                pose[:, axis] += np.bincount(faces[:, corner], vector[:, axis], minlength=pose.shape[0])
    return _normalise(total)


def degenerate_faces(vertices: Float[np.ndarray, "*b n 3"], faces: Int[np.ndarray, "f 3"]) -> np.ndarray:
    """Return which faces, (..., f) bool, are points or have a height below `FLATNESS` over their longest edge."""
    exact = vertices.astype(np.float64)
    corners = exact[..., faces, :]
    longest = (np.roll(corners, -1, axis=-2) - corners) ** 2
    longest = longest.sum(-1).max(-1)
    double_area = np.linalg.norm(face_vectors(exact, faces), axis=-1)
    return double_area <= FLATNESS * longest


def _normalise(vectors: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)


# Edges of a triangle mesh.


def edges(faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "e 2"]:
    """Return every undirected edge once, smaller index first, sorted."""
    pairs = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    return np.unique(pairs, axis=0)


def inner_edges(faces: Int[np.ndarray, "f 3"]) -> tuple[Int[np.ndarray, "e 2"], Int[np.ndarray, "e 2"]]:
    """Return the edges that exactly two faces share, as (vertex pairs, face pairs); the first face runs a → b."""
    directed = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    owner = np.repeat(np.arange(len(faces)), 3)
    undirected = np.sort(directed, axis=1)
    order = np.lexsort((directed[:, 0] > directed[:, 1], undirected[:, 1], undirected[:, 0]))
    ordered = undirected[order]
    starts = np.flatnonzero(np.r_[True, (ordered[1:] != ordered[:-1]).any(1)])
    pairs = starts[np.diff(np.r_[starts, len(ordered)]) == 2]
    return ordered[pairs], np.stack([owner[order[pairs]], owner[order[pairs + 1]]], 1)


# How a surface folds at its edges: signed angles, and which pose folds a patch most.


def fold_angles(
    vertices: Float[np.ndarray, "*b n 3"], faces: Int[np.ndarray, "f 3"], edges: Int[np.ndarray, "e 2"],
    sides: Int[np.ndarray, "e 2"],
) -> Float[np.ndarray, "*b e"]:  # fmt: skip
    """Return the signed angle between the two faces of each inner edge in degrees; 0 is flat, ridges are positive."""
    normals = face_normals(vertices, faces)
    first, second = normals[..., sides[:, 0], :], normals[..., sides[:, 1], :]
    along = vertices[..., edges[:, 1], :] - vertices[..., edges[:, 0], :]
    along = along / np.linalg.norm(along, axis=-1, keepdims=True).clip(1e-12)
    sine = (np.cross(first, second) * along).sum(-1)
    return np.degrees(np.arctan2(sine, (first * second).sum(-1)))


def most_folded(
    mesh: Mesh, poses: Int[np.ndarray, " p"], offsets: Float[np.ndarray, "t n 3"], visible: Bool[np.ndarray, " f"],
    batch: int = 32,
) -> int:  # fmt: skip
    """Return the pose that folds the visible faces most.

    poses: indices of the poses to choose from.
    offsets: V − V⁰ of all poses in mm; may be a memory map.
    visible: which faces count.
    batch: poses at a time.

    The measure is how much the folds at edges between visible faces differ from those in the neutral pose: the mean
    over the edges, weighted by their neutral lengths. Moving or turning the face doesn't change it. Of equal poses the
    first is taken. Raises InputError if no two visible faces share an edge.
    """
    edges, sides = inner_edges(mesh.faces)
    inner = visible[sides].all(-1)
    if not inner.any():
        raise InputError("most_folded: no two of the shown faces share an edge: expected a patch of the mesh")
    edges, sides = edges[inner], sides[inner]
    # only the patch, so that whole heads need not be read into memory
    used, inverse = np.unique(mesh.faces[sides].reshape(-1), return_inverse=True)
    place, face_pairs = np.full(len(mesh.neutral), -1), np.arange(2 * len(sides)).reshape(-1, 2)
    place[used] = np.arange(len(used))
    patch, edges = inverse.reshape(-1, 3), place[edges]
    neutral = mesh.neutral[used]
    rest = fold_angles(neutral, patch, edges, face_pairs)
    length = np.linalg.norm(neutral[edges[:, 1]] - neutral[edges[:, 0]], axis=-1)
    folding = []
    for start in range(0, len(poses), batch):
        posed = neutral + np.stack([np.asarray(offsets[pose])[used] for pose in poses[start : start + batch]])
        change = np.abs(fold_angles(posed.astype(np.float32), patch, edges, face_pairs) - rest)
        folding.append((np.minimum(change, 360 - change) * length).sum(-1) / length.sum())
    return int(poses[np.argmax(np.concatenate(folding))])
