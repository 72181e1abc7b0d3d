"""The same surface with fewer triangles: another topology whose every vertex has a place on the original mesh.

In the paper's Fig. 13 the new mesh is another character, and nobody knows how it should move. For a mesh of the same
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

REACH = 2.0  # mean edges of the original, by which two ways over the surface to the same place may differ


@dataclass(frozen=True)
class NewMesh:
    """A mesh of another topology, and where its vertices lie on the original one.

    mesh: k vertices with texture coordinates in the charts of the original's segments; its segments have their names.
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

    Decimation leaves many vertices where they are; they are relaxed a little, so that nearly all lie between vertices
    of the original and maps are read where nothing was trained.
    segments: indices into `mesh.segment_names`. share: above 0, below 1. shape: the vertices in the pose whose surface
    is decimated, the neutral one by default; a closed mouth would hide its inside, and lose its corners. A new vertex
    belongs to the segment whose vertex is nearest in its triangle of the original.
    """
    if not 0 < share < 1:
        raise InputError(f"share of the vertices: expected a number above 0 and below 1, got {share}.")
    inside = np.flatnonzero(np.isin(mesh.segment, list(segments)))
    faces = inside[faces_within(mesh.faces, inside, len(mesh.neutral))]
    ways = surface_ways(mesh.neutral, faces)
    kept = np.concatenate([mesh.neutral, ways], axis=1)
    new_faces, new = decimated(mesh.neutral if shape is None else shape, faces, share, kept)
    vertices, new_ways = np.split(relaxed(new, new_faces), [3], axis=1)
    normals, nearby = vertex_normals(vertices, new_faces), Nearby(new_ways, ways, reach_of(mesh.neutral, faces))
    places = nearest_places(vertices, mesh.neutral, faces, normals, nearby=nearby)
    return on_original(mesh, new_faces, within_segments(vertices, places, mesh))


def reach_of(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> float:
    """Return by how much ways over a mesh to one place may differ, mm: `REACH` mean edges."""
    return REACH * float(edge_graph(vertices, faces).data.mean())


def within_segments(points: Float[np.ndarray, "k 3"], places: Places, mesh: Mesh) -> Places:
    """Return places whose triangles have all of their corners in one segment, that of the place's nearest corner.

    A place on a triangle between segments moves to the nearest place on those triangles around its nearest corner that
    lie in one segment, or to the corner itself where there is none.
    points: (k, 3), whose places they are, mm.
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

    faces: of the new mesh. places: k, each on a triangle of one segment, which becomes the vertex's. Triangles without
    area are left out, and so are vertices in no triangle.
    """
    neutral = places.mix(mesh.neutral)
    faces = faces[~degenerate_faces(neutral, faces)]
    used, new_faces = np.unique(faces, return_inverse=True)
    places = Places(places.corners[used], places.shares[used])
    present, index = np.unique(mesh.segment[places.corners[:, 0]], return_inverse=True)
    uv = places.mix(mesh.uv).clip(0, 1)  # rounding can leave the chart by a millionth
    names = tuple(mesh.segment_names[k] for k in present)
    new = Mesh(neutral[used], new_faces.reshape(-1, 3).astype(np.int32), uv, index.astype(np.int32), names)
    return NewMesh(new, places)


def relaxed(values: Float32[np.ndarray, "k d"], faces: Int[np.ndarray, "g 3"]) -> Float32[np.ndarray, "k d"]:
    """Return values of vertices, moved half way to the mean of their neighbours'; those on a border stay."""
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
    """Return the faces of a surface with a share of its triangles, and the values of its k new vertices.

    By quadric error metrics (Garland and Heckbert 1997); vertices of no face are left out. values: of the old vertices,
    mixed as these are merged, such as positions in another pose.
    """
    import pyvista
    from vtkmodules.vtkFiltersCore import vtkQuadricDecimation

    used, local = np.unique(faces, return_inverse=True)
    surface = pyvista.PolyData.from_regular_faces(np.asarray(vertices[used], np.float32), local.reshape(-1, 3))
    surface.point_data["values"] = np.asarray(values[used], np.float32)
    decimation = vtkQuadricDecimation()
    decimation.SetInputData(surface)
    decimation.SetTargetReduction(1 - share)
    decimation.SetMapPointData(True)
    decimation.Update()
    coarser = pyvista.wrap(decimation.GetOutput()).clean(point_merging=False)
    new = np.array(coarser.point_data["values"], np.float32).reshape(coarser.n_points, -1)
    return np.array(coarser.regular_faces, np.int32), new
