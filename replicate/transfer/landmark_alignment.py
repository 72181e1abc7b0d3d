"""Another character's face in the charts of the original's: the two neutral faces are brought together by landmarks.

In the paper the texture coordinates of the other mesh "are manually aligned to those of the original mesh" (§6). Here a
thin-plate spline through landmarks that both characters have bends the other face onto the original. Each of its
vertices then has a place there, and so a chart and coordinates in it, however either face is cut into segments.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64
from scipy.interpolate import RBFInterpolator
from scipy.sparse.csgraph import dijkstra

from data_recipes.rig import Rig
from replicate.approximation.segments import faces_within
from replicate.base.exceptions import InputError
from replicate.geometry.mesh import Mesh, face_vectors, vertex_normals
from replicate.transfer.remeshing import NewMesh
from replicate.transfer.surface_places import FAR_MM, Places, edge_graph, nearest_faces, nearest_places

# The face of a character: the segments with that name, and ways over its skin, which never cross a slit.

FACE = "face"  # what the names of a face's segments begin with


@dataclass(frozen=True)
class Face:
    """A face: the vertices (k,) of its mesh that its triangles use, ascending.

    faces: (f, 3) its triangles, as vertices of the mesh, and local: (f, 3) as positions in `vertices`. whole: (w, 3)
    the triangles that lie in one segment, as vertices of the mesh.
    """

    vertices: np.ndarray
    faces: np.ndarray
    local: np.ndarray
    whole: np.ndarray


def face_of(mesh: Mesh) -> Face:
    """Return the face of a mesh: its segments named "face…". Raises InputError where there is none."""
    segments = [k for k, name in enumerate(mesh.segment_names) if name.startswith(FACE)]
    if not segments:
        names = ", ".join(mesh.segment_names[:4])
        raise InputError(f"segments of the mesh: expected at least one whose name begins with {FACE!r}, got {names} …")
    inside = np.flatnonzero(np.isin(mesh.segment, segments))
    faces = inside[faces_within(mesh.faces, inside, len(mesh.neutral))]
    vertices, local = np.unique(faces, return_inverse=True)
    segment = mesh.segment[faces]
    return Face(vertices, faces, local.reshape(-1, 3), faces[(segment == segment[:, :1]).all(1)])


def upper_over_lower(
    vertices: Float[np.ndarray, "n 3"], face: Face, marks: Mapping[str, int]
) -> Float64[np.ndarray, " n"]:
    """Return for each vertex how much shorter the way over the skin is to an upper lid or lip than to a lower one, mm.

    Beside the seam of closed lips that is tens of millimetres, positive above it and negative below. marks: landmarks
    by name, of which those with "upper" or "lower" in it are used. Without both kinds, and off the face, it is 0.
    """
    kinds = [[v for name, v in marks.items() if kind in name] for kind in ("upper", "lower")]
    if not all(kinds):
        return np.zeros(len(vertices))
    upper, lower = (_ways(vertices, face, kind) for kind in kinds)
    return np.clip(lower, 0, FAR_MM) - np.clip(upper, 0, FAR_MM)


def _ways(vertices: np.ndarray, face: Face, marks: list[int]) -> np.ndarray:
    """Return the length of the shortest way along edges from each vertex to one of some landmarks."""
    return dijkstra(edge_graph(vertices, face.faces), directed=False, indices=marks, min_only=True)


FEWEST = 8  # landmarks that both faces need: four settle an affine map of space, and no face is a tetrahedron
REACH_MM = 20.0  # what lies farther from the original's face, once landmarks agree, doesn't belong to the face
LEAD_MM = 3.0  # a place that faces another way is taken if it is this much nearer: lids and lips turn inwards
CLEAR_MM = 2.0  # a vertex belongs to the lid or lip that is nearer over the skin by this much


@dataclass(frozen=True)
class Marks:
    """Landmarks by name, as vertices (l,) of the original and (l,) of the other character."""

    names: tuple[str, ...]
    source: np.ndarray
    target: np.ndarray


@dataclass(frozen=True)
class AlignedFace:
    """Another character's face with charts of the original's.

    new: k vertices where the other character has them in neutral, mm, and their places on the original's face.
    vertices: (k,) which vertices of the other character they are. counterpart: (g,) the triangle of
    `face_of(original)` that each of theirs follows. scale: how much larger the other face is; offsets are multiplied
    by it.
    """

    new: NewMesh
    vertices: np.ndarray
    counterpart: np.ndarray
    scale: float


def shared_marks(source: Rig, target: Rig) -> Marks:
    """Return all landmarks and control points whose names both characters have; a vertex with two is used once.

    Raises InputError where fewer than `FEWEST` are left.
    """
    ours, theirs = _named(source), _named(target)
    pairs: dict[str, tuple[int, int]] = {}
    for name in sorted(ours.keys() & theirs.keys()):
        if all(ours[name] != a and theirs[name] != b for a, b in pairs.values()):
            pairs[name] = ours[name], theirs[name]
    if len(pairs) < FEWEST:
        raise InputError(
            f"{source.name} and {target.name} have {len(pairs)} landmarks of the same names: at least {FEWEST} are "
            "needed to align them"
        )
    vertices = np.array(list(pairs.values()))
    return Marks(tuple(pairs), vertices[:, 0], vertices[:, 1])


def size_ratio(source: Float[np.ndarray, "l 3"], target: Float[np.ndarray, "l 3"]) -> float:
    """Return how much larger the target is: the ratio of the mean distances between landmarks."""
    return float(_apart(target).mean() / _apart(source).mean())


def spline_through(
    source: Float[np.ndarray, "l 3"], target: Float[np.ndarray, "l 3"]
) -> Callable[[Float[np.ndarray, "k 3"]], Float64[np.ndarray, "k 3"]]:
    """Return the thin-plate spline that takes the source's landmarks to the target's, and points of space with them."""
    spline = RBFInterpolator(source.astype(np.float64), target.astype(np.float64), kernel="thin_plate_spline")
    return lambda points: spline(np.asarray(points, np.float64))


def aligned(source: Mesh, target: Mesh, marks: Marks) -> AlignedFace:
    """Return the target's face with the charts of the nearest places on the source's, once landmarks agree.

    Places lie on triangles of one segment that face the same way, and never on the other lid or lip; where the target's
    skin turns inwards and the source's does not, on the nearest. Triangles of the target that are farther than
    `REACH_MM` from the source's face are left out. Raises InputError for a mesh without a face.
    """
    ours, theirs = face_of(source), face_of(target)
    bend = spline_through(target.neutral[marks.target], source.neutral[marks.source])
    bent = bend(target.neutral)
    places = _places(source, ours, bent, theirs, marks)
    near = np.linalg.norm(places.mix(source.neutral) - bent[theirs.vertices], axis=1) <= REACH_MM
    kept, faces = np.unique(theirs.local[near[theirs.local].all(1)], return_inverse=True)
    if not len(kept):
        raise InputError(f"no part of the other face lies within {REACH_MM:g} mm of the original's")
    faces = faces.reshape(-1, 3).astype(np.int32)
    vertices, places = theirs.vertices[kept], Places(places.corners[kept], places.shares[kept])
    present, index = np.unique(source.segment[places.corners[:, 0]], return_inverse=True)
    uv = places.mix(source.uv).clip(0, 1)  # rounding can leave the chart by a millionth
    names = tuple(source.segment_names[k] for k in present)
    mesh = Mesh(target.neutral[vertices], faces, uv, index.astype(np.int32), names)
    points = bent[vertices]
    centres = points[faces].mean(1)
    counterpart = nearest_faces(centres, source.neutral, ours.faces, face_vectors(points, faces), LEAD_MM)
    scale = size_ratio(source.neutral[marks.source], target.neutral[marks.target])
    return AlignedFace(NewMesh(mesh, places), vertices, counterpart, scale)


def _places(source: Mesh, ours: Face, bent: np.ndarray, theirs: Face, marks: Marks) -> Places:
    """Return the place on the source's face of each vertex of the bent target's."""
    points, normals = bent[theirs.vertices], vertex_normals(bent, theirs.faces)[theirs.vertices]
    side = upper_over_lower(bent, theirs, dict(zip(marks.names, marks.target.tolist(), strict=True)))[theirs.vertices]
    sides = upper_over_lower(source.neutral, ours, dict(zip(marks.names, marks.source.tolist(), strict=True)))
    side_of_face = sides[ours.whole].mean(1)
    corners, shares = np.empty((len(points), 3), np.int64), np.empty((len(points), 3))
    group = np.where(side > CLEAR_MM, 1, np.where(side < -CLEAR_MM, -1, 0))
    for sign in np.unique(group):
        chosen = group == sign
        faces = ours.whole[sign * side_of_face >= 0]
        found = nearest_places(points[chosen], source.neutral, faces, normals[chosen], LEAD_MM)
        corners[chosen], shares[chosen] = found.corners, found.shares
    return Places(corners, shares)


def _named(rig: Rig) -> dict[str, int]:
    points = zip(rig.control_point_names, rig.control_points.tolist(), strict=False)
    return dict(zip(rig.landmark_names, rig.landmarks.tolist(), strict=False)) | dict(points)


def _apart(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points[:, None].astype(np.float64) - points, axis=-1)
