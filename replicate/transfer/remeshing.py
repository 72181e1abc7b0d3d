"""The same surface with fewer triangles: another topology whose every vertex has a place on the original mesh.

In the paper's Fig. 13 the new mesh is another character, and nobody knows how it should move. Of a new mesh of the same
surface the truth is known in any pose: what the rig does at the place of each of its vertices.
"""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32, Int
from scipy.sparse import coo_array, csr_array

from replicate.approximation.segments import faces_within
from replicate.base.exceptions import InputError
from replicate.geometry.mesh import Mesh, degenerate_faces, vertex_normals
from replicate.transfer.surface_places import Nearby, Places, edge_graph, nearest_places, surface_ways

REACH = 2.0  # mean edges of the original: by as much may two ways over the surface to the same place differ


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


def remeshed(
    mesh: Mesh, segments: Collection[int], share: float, shape: Float[np.ndarray, "n 3"] | None = None
) -> NewMesh:
    """Return a mesh of the surface of some segments with about a share of their vertices.

    Decimation leaves many vertices where they are; relaxed a little, nearly all are at places that no vertex of the
    original has, so that maps are read where nothing was trained.
    segments: indices into `mesh.segment_names`. share: above 0, below 1. shape: the vertices in the pose whose surface
    is decimated, the neutral one if none is given: a closed mouth hides what it has inside, and its corners are lost. A
    new vertex belongs to the segment whose vertex is nearest in its triangle of the original.
    """
    if not 0 < share < 1:
        raise InputError(f"share of the vertices: expected a number above 0 and below 1, got {share}.")
    own = np.flatnonzero(np.isin(mesh.segment, list(segments)))
    faces = own[faces_within(mesh.faces, own, len(mesh.neutral))]
    ways = surface_ways(mesh.neutral, faces)
    kept = np.concatenate([mesh.neutral, ways], axis=1)
    new_faces, new = decimated(mesh.neutral if shape is None else shape, faces, share, kept)
    vertices, own_ways = np.split(relaxed(new, new_faces), [3], axis=1)
    normals, nearby = vertex_normals(vertices, new_faces), Nearby(own_ways, ways, reach_of(mesh.neutral, faces))
    places = nearest_places(vertices, mesh.neutral, faces, normals, nearby=nearby)
    return on_original(mesh, new_faces, within_segments(vertices, places, mesh))


def reach_of(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> float:
    """Return by how much ways over a mesh may differ in one place: the mean edge, `REACH` times, mm."""
    return REACH * float(edge_graph(vertices, faces).data.mean())


def within_segments(points: Float[np.ndarray, "k 3"], places: Places, mesh: Mesh) -> Places:
    """Return places whose triangles have all of their corners in one segment, that of the place's nearest corner.

    A place on a triangle between segments goes to the nearest place of those triangles around its nearest corner that
    lie in one segment, or to the corner itself where there is none.
    points: (k, 3), what the places are of, mm.
    """
    corner, segment = places.nearest_corner, mesh.segment
    corners, shares = np.repeat(corner[:, None], 3, axis=1), np.tile([1.0, 0.0, 0.0], (len(corner), 1))
    kept = (segment[places.corners] == segment[corner][:, None]).all(1)
    corners[kept], shares[kept] = places.corners[kept], places.shares[kept]
    whole = mesh.faces[(segment[mesh.faces] == segment[mesh.faces[:, :1]]).all(1)]
    around = coo_array((np.ones(whole.size), (whole.ravel(), np.repeat(np.arange(len(whole)), 3))),
                       shape=(len(segment), len(whole))).tocsr()  # fmt: skip
    for moved in np.flatnonzero(~kept):
        faces = whole[around[[corner[moved]]].indices]
        if len(faces):
            nearest = nearest_places(points[[moved]], mesh.neutral, faces)
            corners[moved], shares[moved] = nearest.corners[0], nearest.shares[0]
    return Places(corners, shares)


def on_original(mesh: Mesh, faces: Int[np.ndarray, "g 3"], places: Places) -> NewMesh:
    """Return a new mesh with its k vertices at some places on the original's neutral surface.

    faces: of the new mesh. places: k, each on a triangle of one segment, which the vertex then belongs to. Triangles
    that have no area there are left out, and vertices in no triangle with them.
    """
    neutral = places.mix(mesh.neutral)
    faces = faces[~degenerate_faces(neutral, faces)]
    used, new_faces = np.unique(faces, return_inverse=True)
    places = Places(places.corners[used], places.shares[used])
    present, index = np.unique(mesh.segment[places.corners[:, 0]], return_inverse=True)
    uv = places.mix(mesh.uv).clip(0, 1)  # rounding leaves the chart by a millionth
    names = tuple(mesh.segment_names[k] for k in present)
    new = Mesh(neutral[used], new_faces.reshape(-1, 3).astype(np.int32), uv, index.astype(np.int32), names)
    return NewMesh(new, places)


def relaxed(values: Float32[np.ndarray, "k d"], faces: Int[np.ndarray, "g 3"]) -> Float32[np.ndarray, "k d"]:
    """Return what vertices have moved half of the way to the mean of their neighbours; those on a border stay."""
    a, b = faces[:, [0, 1, 2]].ravel(), faces[:, [1, 2, 0]].ravel()
    directed = csr_array((np.ones(len(a)), (a, b)), shape=(len(values),) * 2)
    triangles = directed + directed.T  # at each edge, how many
    border = triangles.indices[triangles.data != 2]
    adjacency = triangles.astype(bool).astype(np.float64)
    moved = (values + (adjacency @ values) / np.maximum(adjacency.sum(1), 1)[:, None]) / 2
    moved[border] = values[border]
    return moved.astype(np.float32)


def decimated(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], share: float, values: Float[np.ndarray, "n d"]
) -> tuple[Int[np.ndarray, "g 3"], Float32[np.ndarray, "k d"]]:
    """Return the faces of a surface with a share of its triangles, and what k new vertices have of some values.

    By quadric error metrics (Garland and Heckbert 1997); vertices of no face are left out. values: of the vertices,
    mixed as these are merged: the positions in another pose, say.
    """
    import pyvista
    from vtkmodules.vtkFiltersCore import vtkQuadricDecimation

    used, own = np.unique(faces, return_inverse=True)
    surface = pyvista.PolyData.from_regular_faces(np.asarray(vertices[used], np.float32), own.reshape(-1, 3))
    surface.point_data["values"] = np.asarray(values[used], np.float32)
    decimation = vtkQuadricDecimation()
    decimation.SetInputData(surface)
    decimation.SetTargetReduction(1 - share)
    decimation.SetMapPointData(True)
    decimation.Update()
    coarser = pyvista.wrap(decimation.GetOutput()).clean(point_merging=False)
    new = np.array(coarser.point_data["values"], np.float32).reshape(coarser.n_points, -1)
    return np.array(coarser.regular_faces, np.int32), new
