"""The face of a character: the segments that are named so, and ways over its skin, which no slit crosses."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64
from scipy.sparse.csgraph import dijkstra

from replicate.approximation.segments import faces_within
from replicate.engine.exceptions import InputError
from replicate.geometry.mesh import Mesh
from replicate.transfer.surface_ways import FAR_MM, edge_graph

FACE = "face"  # what the names of a face's segments begin with


@dataclass(frozen=True)
class Face:
    """A face: the vertices (k,) of its mesh that its triangles use, ascending.

    faces: (f, 3) its triangles, as vertices of the mesh, and local: (f, 3) as positions in `vertices`. whole: (w, 3),
    those of them that lie in one segment, as vertices of the mesh.
    """

    vertices: np.ndarray
    faces: np.ndarray
    local: np.ndarray
    whole: np.ndarray


def face_of(mesh: Mesh) -> Face:
    """Return the face of a mesh: what lies in segments named "face…". Raises InputError where none is named so."""
    segments = [k for k, name in enumerate(mesh.segment_names) if name.startswith(FACE)]
    if not segments:
        names = ", ".join(mesh.segment_names[:4])
        raise InputError(f"the names of the mesh's segments are {names} …: at least one has to begin with {FACE!r}")
    inside = np.flatnonzero(np.isin(mesh.segment, segments))
    faces = inside[faces_within(mesh.faces, inside, len(mesh.neutral))]
    vertices, local = np.unique(faces, return_inverse=True)
    segment = mesh.segment[faces]
    return Face(vertices, faces, local.reshape(-1, 3), faces[(segment == segment[:, :1]).all(1)])


def upper_over_lower(
    vertices: Float[np.ndarray, "n 3"], face: Face, marks: Mapping[str, int]
) -> Float64[np.ndarray, " n"]:
    """Return for each vertex how much shorter the way over the skin is to an upper lid or lip than to a lower one, mm.

    Beside the seam of closed lips that is tens of millimetres, above it more than 0 and below it less. marks: landmarks
    by name; those with "upper" or "lower" in it count. Without any of either kind, and off the face, it is 0.
    """
    kinds = [[v for name, v in marks.items() if kind in name] for kind in ("upper", "lower")]
    if not all(kinds):
        return np.zeros(len(vertices))
    upper, lower = (_ways(vertices, face, kind) for kind in kinds)
    return np.clip(lower, 0, FAR_MM) - np.clip(upper, 0, FAR_MM)


def _ways(vertices: np.ndarray, face: Face, marks: list[int]) -> np.ndarray:
    """Return the length of the shortest way along edges from each vertex to one of some landmarks."""
    return dijkstra(edge_graph(vertices, face.faces), directed=False, indices=marks, min_only=True)
