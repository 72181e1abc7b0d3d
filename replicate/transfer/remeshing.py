"""The same surface with fewer triangles: another topology whose every vertex has a place on the original mesh.

In the paper's Fig. 13 the new mesh is another character, and nobody knows how it should move. Of a new mesh of the same
surface the truth is known in any pose: what the rig does at the place of each of its vertices.
"""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32, Int
from scipy.sparse import csr_array

from replicate.approximation.segments import faces_within
from replicate.engine.exceptions import InputError
from replicate.geometry.mesh import Mesh
from replicate.geometry.normals import degenerate_faces, vertex_normals
from replicate.transfer.surface_places import Places, nearest_places


@dataclass(frozen=True)
class NewMesh:
    """A mesh of another topology, and where its vertices lie on the original one.

    mesh: k vertices with texture coordinates in the charts of the original's segments, by whose names its own go.
    places: k of them, each on a triangle of the original that has all of its corners in the vertex's segment.
    """

    mesh: Mesh
    places: Places

    def save(self, file: Path) -> None:
        """Write both as npz files: `file` and, for the places, its name with `_places`."""
        self.mesh.save(file)
        np.savez(_places_file(file), corners=self.places.corners, shares=self.places.shares)

    @classmethod
    def load(cls, file: Path) -> "NewMesh":
        """Read what `save` wrote."""
        with np.load(_places_file(file), allow_pickle=False) as stored:
            return cls(Mesh.load(file), Places(stored["corners"], stored["shares"]))


def _places_file(file: Path) -> Path:
    return file.with_name(f"{file.stem}_places{file.suffix}")


def remeshed(mesh: Mesh, segments: Collection[int], share: float) -> NewMesh:
    """Return a mesh of the surface of some segments with about a share of their vertices.

    Decimation leaves many vertices where they are; relaxed a little, nearly all are at places that no vertex of the
    original has, so that maps are read where nothing was trained.
    segments: indices into `mesh.segment_names`. share: above 0, below 1. A new vertex belongs to the segment whose
    vertex is nearest in its triangle of the original, and is put on the nearest place of that segment.
    """
    if not 0 < share < 1:
        raise InputError(f"share of the vertices is {share}: allowed is a number above 0 and below 1.")
    own = np.flatnonzero(np.isin(mesh.segment, list(segments)))
    faces = own[faces_within(mesh.faces, own, len(mesh.neutral))]
    vertices, new_faces = decimated(mesh.neutral, faces, share)
    vertices = relaxed(vertices, new_faces)
    normals = vertex_normals(vertices, new_faces)
    segment = mesh.segment[nearest_places(vertices, mesh.neutral, faces, normals).nearest_corner]
    return on_original(mesh, vertices, new_faces, segment, normals)


def on_original(
    mesh: Mesh,
    vertices: Float[np.ndarray, "k 3"],
    faces: Int[np.ndarray, "g 3"],
    segment: Int[np.ndarray, " k"],
    normals: Float[np.ndarray, "k 3"] | None = None,
) -> NewMesh:
    """Return a new mesh with its vertices put on the nearest place of the original's neutral surface.

    vertices: of the new mesh, near that surface, mm. segment: the original's segment that each belongs to, by index.
    normals: of the new vertices, to tell the two sides of a slit apart. Triangles that have no area there are left out,
    and vertices in no triangle with them.
    """
    corners, shares = np.empty((len(vertices), 3), np.int32), np.empty((len(vertices), 3))
    for k in np.unique(segment):
        chosen, inside = np.flatnonzero(segment == k), np.flatnonzero(mesh.segment == k)
        within = inside[faces_within(mesh.faces, inside, len(mesh.neutral))]
        if len(within) == 0:
            name = mesh.segment_names[k]
            raise InputError(f"mesh: segment {name!r} has no face of its own, where at least one is needed.")
        places = nearest_places(vertices[chosen], mesh.neutral, within, None if normals is None else normals[chosen])
        corners[chosen], shares[chosen] = places.corners, places.shares
    neutral = Places(corners, shares).mix(mesh.neutral)
    faces = faces[~degenerate_faces(neutral, faces)]
    used, new_faces = np.unique(faces, return_inverse=True)
    places = Places(corners[used], shares[used])
    present, index = np.unique(segment[used], return_inverse=True)
    uv = places.mix(mesh.uv).clip(0, 1)  # rounding leaves the chart by a millionth
    names = tuple(mesh.segment_names[k] for k in present)
    new = Mesh(neutral[used], new_faces.reshape(-1, 3).astype(np.int32), uv, index.astype(np.int32), names)
    return NewMesh(new, places)


def relaxed(vertices: Float32[np.ndarray, "k 3"], faces: Int[np.ndarray, "g 3"]) -> Float32[np.ndarray, "k 3"]:
    """Return the vertices moved half of the way to the mean of their neighbours; those on a border stay."""
    a, b = faces[:, [0, 1, 2]].ravel(), faces[:, [1, 2, 0]].ravel()
    directed = csr_array((np.ones(len(a)), (a, b)), shape=(len(vertices),) * 2)
    triangles = directed + directed.T  # at each edge, how many
    border = triangles.indices[triangles.data != 2]
    adjacency = triangles.astype(bool).astype(np.float64)
    moved = (vertices + (adjacency @ vertices) / np.maximum(adjacency.sum(1), 1)[:, None]) / 2
    moved[border] = vertices[border]
    return moved.astype(np.float32)


def decimated(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], share: float
) -> tuple[Float32[np.ndarray, "k 3"], Int[np.ndarray, "g 3"]]:
    """Return a surface with a share of its triangles, by quadric error metrics (Garland and Heckbert 1997).

    Vertices of no face are left out; the others move off the surface by little.
    """
    import pyvista

    used, own = np.unique(faces, return_inverse=True)
    surface = pyvista.PolyData.from_regular_faces(np.asarray(vertices[used], np.float32), own.reshape(-1, 3))
    coarser = surface.decimate(1 - share).clean(point_merging=False)
    return np.array(coarser.points, np.float32), np.array(coarser.regular_faces, np.int32)
