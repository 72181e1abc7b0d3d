"""From a mesh file to our mesh: a segment and one place in a chart for every vertex, with new charts where needed.

A vertex belongs to the segment of most of its faces, unless a group of an OBJ lists it. It takes the texture
coordinates that most of its corners in that segment have. So a vertex on a seam is not split but lies on one side of
it, and the mesh keeps the vertices of the poses, in their order. Charts are stretched over the unit square unless they
nearly fill it. Vertices in no face are a segment of their own: in any other's chart they would be in the way.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from data_recipes.sampled.mesh_file import NeutralFile
from replicate.base.exceptions import InputError
from replicate.geometry.mesh import Mesh, degenerate_faces

MOST_SEGMENTS = 300
MOST_OVERLAP = 0.02  # the share of a segment's texels that may be covered twice
FULL = 0.9  # a chart that spans this share of the unit square along both axes is not stretched
LEAST_COVER = 0.15  # the share of the unit square that a segment's charts must cover
LONGEST_NAME = 60  # bytes
WITHOUT_NAME, UNUSED = "rest", "unused"


def make_mesh(neutral: NeutralFile, segments: str, vertices_mm: Float[np.ndarray, "n 3"], where: str) -> Mesh:
    """Return the mesh of a file, without the faces that have no area in the neutral pose.

    segments: "groups", "materials" or "islands".
    vertices_mm: in our axes.
    where: the file, for messages.
    Raises InputError for islands of a mesh without texture coordinates, for too many segments, and for a mesh whose
    faces all have no area.
    """
    check_segments(neutral, segments, where)
    vertices = np.asarray(vertices_mm, np.float32)
    solid = ~degenerate_faces(vertices, neutral.faces.astype(np.int32))
    all_labels, names = face_segments(neutral, segments)
    faces, labels = neutral.faces[solid], all_labels[solid]
    if not len(faces):
        raise InputError(f"{where}: no face has an area, expected a surface")
    segment = _most(faces, labels, len(vertices))
    alone = segment < 0  # only in faces without an area
    segment[alone] = _most(neutral.faces, all_labels, len(vertices))[alone]
    if segments == "groups":
        for name, members in neutral.members.items():
            if name in names:
                segment[members] = names.index(name)
    if len(neutral.unused):
        segment[neutral.unused], names = len(names), [*names, UNUSED]
    uv = np.empty((len(vertices), 2))
    for k in np.unique(segment):
        members = np.flatnonzero(segment == k)
        uv[members] = _chart(neutral, vertices, np.flatnonzero(solid)[labels == k], members)
    used, segment = np.unique(segment, return_inverse=True)
    clean = _clean_names([names[k] for k in used])
    return Mesh(vertices, faces.astype(np.int32), uv.astype(np.float32), segment.astype(np.int32), clean)


def check_segments(neutral: NeutralFile, segments: str, where: str) -> None:
    """Raise InputError where a mesh can't have such segments."""
    without = len(neutral.faces) if neutral.uv is None else int((neutral.uv_faces < 0).any(axis=1).sum())
    if segments == "islands" and without:
        raise InputError(
            f"{where}: {without} of {len(neutral.faces)} triangles have no texture coordinates, which segments = "
            '"islands" needs: write "groups" or "materials", for which charts are made, or give all of them some'
        )
    count = len(face_segments(neutral, segments)[1])
    if count > MOST_SEGMENTS:
        raise InputError(f"{where}: expected at most {MOST_SEGMENTS} segments, got {count} {segments}")


def face_segments(neutral: NeutralFile, segments: str) -> tuple[Int[np.ndarray, " f"], list[str]]:
    """Return each face's segment and the segments' names, in the order of the file, or islands by size."""
    if segments == "islands":
        return _islands(neutral)
    labels = neutral.groups if segments == "groups" else neutral.materials
    names = list(dict.fromkeys(labels))
    place = {name: k for k, name in enumerate(names)}
    return np.array([place[label] for label in labels], np.int64), names


def _islands(neutral: NeutralFile) -> tuple[Int[np.ndarray, " f"], list[str]]:
    """Return the connected parts of the texture's layout; faces that share an edge in it are connected."""
    corners = neutral.uv_faces
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]]])
    graph = coo_array((np.ones(len(edges)), edges.T), shape=(len(neutral.uv), len(neutral.uv)))
    _, island = connected_components(graph, directed=False)
    used, of_face, sizes = np.unique(island[corners[:, 0]], return_inverse=True, return_counts=True)
    order = np.argsort(-sizes, kind="stable")
    rank = np.empty(len(used), np.int64)
    rank[order] = np.arange(len(used))
    return rank[of_face], [f"island_{k + 1:02d}" for k in range(len(used))]


def _most(faces: np.ndarray, labels: np.ndarray, count: int) -> np.ndarray:
    """Return the label that most of a vertex's faces have; −1 for a vertex without a face."""
    width = int(labels.max()) + 1
    votes = coo_array((np.ones(faces.size, np.int64), (faces.ravel(), np.repeat(labels, 3))), shape=(count, width))
    votes = votes.tocsr()
    best = np.full(count, -1, np.int64)
    for vertex in np.flatnonzero(np.diff(votes.indptr)):
        row = slice(votes.indptr[vertex], votes.indptr[vertex + 1])
        counts, columns = votes.data[row], votes.indices[row]
        best[vertex] = columns[counts == counts.max()].min()
    return best


def _chart(
    neutral: NeutralFile,
    vertices: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, " g"],
    members: Int[np.ndarray, " k"],
) -> Float[np.ndarray, "k 2"]:
    """Return the places in the unit square of a segment's vertices, `members`. faces: indices of its faces."""
    if not len(faces):
        return np.full((len(members), 2), 0.5)
    if neutral.uv is not None and (neutral.uv_faces[faces] >= 0).all():
        corners, places = neutral.uv[neutral.uv_faces[faces]], neutral.uv_faces[faces]
        inside = np.isin(neutral.faces[faces], members)  # corners at other segments' vertices are left out
        if inside.any():
            corners = stretched(corners, corners[inside])
            covered, doubled = covered_and_doubled(corners[inside.all(axis=1)])
            if not inside.all(axis=1).any() or (doubled <= MOST_OVERLAP and covered >= LEAST_COVER):
                return one_place(neutral.faces[faces][inside], places[inside], corners[inside], members)
    return made_chart(vertices, neutral.faces[faces], members)


def stretched(uv: Float[np.ndarray, "*b 2"], box: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, "*b 2"]:
    """Return texture coordinates in the unit square, stretched along each axis so that those of `box` fill it.

    A box within the unit square that spans FULL of it along both axes stays as it is.
    """
    low, high = box.min(axis=0), box.max(axis=0)
    if not ((low >= 0).all() and (high <= 1).all() and (high - low >= FULL).all()):
        uv = (uv - low) / np.where(high > low, high - low, 1.0)
    return np.clip(uv, 0.0, 1.0)


def one_place(
    vertex: Int[np.ndarray, " c"],
    place: Int[np.ndarray, " c"],
    uv: Float[np.ndarray, "c 2"],
    members: Int[np.ndarray, " k"],
) -> Float[np.ndarray, "k 2"]:
    """Return for each member the coordinates that most of its corners have; on a tie, those that come first.

    vertex, uv: of each corner.
    place: equal where corners have the same coordinates.
    members: vertices; one without a corner gets the middle.
    """
    pairs, first, counts = np.unique(np.stack([vertex, place], 1), axis=0, return_index=True, return_counts=True)
    order = np.lexsort((first, -counts, pairs[:, 0]))
    best, at = np.unique(pairs[order, 0], return_index=True)
    result = np.full((int(max(members.max(), vertex.max())) + 1, 2), 0.5)
    result[best] = uv[first[order][at]]
    return result[members]


def made_chart(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "g 3"], members: Int[np.ndarray, " k"]
) -> Float[np.ndarray, "k 2"]:
    """Return the members' places in charts that xatlas makes of a segment's faces and packs into the unit square."""
    import xatlas  # a mesh with charts does without it

    used, inner = np.unique(faces, return_inverse=True)
    inner = inner.reshape(-1, 3).astype(np.uint32)
    of_new, corners, uv = xatlas.parametrize(np.ascontiguousarray(vertices[used], np.float32), inner)
    places = np.asarray(corners, np.int64).reshape(-1, 3)
    if not len(places):
        return np.full((len(members), 2), 0.5)
    corners = np.asarray(uv, float)[places].reshape(-1, 2)
    return one_place(used[of_new[places]].ravel(), places.ravel(), stretched(corners, corners), members)


def clean_name(name: str) -> str:
    """Return a segment's name with other characters than letters and digits of any script, _ and - replaced."""
    safe = (c if c in "_-" or unicodedata.category(c)[0] in "LMN" else " " for c in unicodedata.normalize("NFC", name))
    stem = re.sub(r"\s+", "_", "".join(safe)).strip("_")
    return stem.encode()[:LONGEST_NAME].decode(errors="ignore") or WITHOUT_NAME


def _clean_names(names: Sequence[str]) -> tuple[str, ...]:
    """Return names that differ and consist of letters, digits, _ and -."""
    clean: list[str] = []
    for name in names:
        stem = clean_name(name)
        chosen, k = stem, 1
        while chosen in clean:
            k += 1
            chosen = f"{stem}_{k}"
        clean.append(chosen)
    return tuple(clean)


# Whether charts overlap: the share of the unit square that triangles cover, and the share of that covered twice.

TEXELS = 256  # a side


def covered_and_doubled(corners: Float[np.ndarray, "f 3 2"]) -> tuple[float, float]:
    """Return the share of the unit square that triangles cover, and the share of that covered by more than one.

    A triangle covers the texels whose middles lie inside it, not on its edges.
    """
    counts = np.zeros((TEXELS, TEXELS), np.int32)  # row: v
    places = corners * TEXELS - 0.5
    low = np.clip(np.ceil(places.min(axis=1)).astype(int), 0, TEXELS)
    high = np.clip(np.floor(places.max(axis=1)).astype(int) + 1, 0, TEXELS)
    for triangle in np.flatnonzero((high > low).all(axis=1)):
        (left, lower), (right, upper) = low[triangle].tolist(), high[triangle].tolist()
        counts[lower:upper, left:right] += _inside(places[triangle], left, right, lower, upper)
    covered = counts > 0
    return float(covered.mean()), float((counts > 1).sum() / max(covered.sum(), 1))


def _inside(triangle: np.ndarray, left: int, right: int, lower: int, upper: int) -> np.ndarray:
    """Return (rows, columns) bool, whether a texel's middle lies inside a triangle of either orientation."""
    x, y = np.arange(left, right)[None, :], np.arange(lower, upper)[:, None]
    sides = []
    for (ax, ay), (bx, by) in zip(triangle, np.roll(triangle, -1, axis=0), strict=True):
        sides.append((bx - ax) * (y - ay) - (by - ay) * (x - ax))
    a, b, c = sides
    return ((a > 0) & (b > 0) & (c > 0)) | ((a < 0) & (b < 0) & (c < 0))
