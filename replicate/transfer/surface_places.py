"""Places on a surface, each a triangle and barycentric coordinates, and a mesh's values there.

Through the places of its vertices on the original mesh, a new mesh gets its neutral pose, its texture coordinates, and
in any pose of the rig its true vertices.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Int
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.distance import cdist

from replicate.geometry.mesh import edges, face_vectors

# Ways over a surface, along the edges of its mesh: two lips that touch are far apart on them.

ENDS = 12  # of the ways that tell where a vertex is on a surface
FAR_MM = 1_000.0  # the longest way that counts, and that between two parts which no edge joins


@dataclass(frozen=True)
class Nearby:
    """Which triangles of a mesh each of k points may lie on: those whose ways over the surface are as long.

    points: (k, e), vertices: (n, e), the lengths of the ways to the same e places, from `surface_ways`, mm. reach: by
    how much any of them may differ, mm; where all triangles differ by more, those that differ least.
    """

    points: np.ndarray
    vertices: np.ndarray
    reach: float


def edge_graph(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> csr_array:
    """Return the lengths of the edges of a mesh, each once, as a matrix over its vertices."""
    a, b = edges(faces).T
    lengths = np.linalg.norm(vertices[a].astype(np.float64) - vertices[b], axis=1)
    return coo_array((lengths, (a, b)), shape=(len(vertices),) * 2).tocsr()


def surface_ways(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], count: int = ENDS
) -> Float64[np.ndarray, "n count"]:
    """Return the length of the shortest way from each vertex to some ends that are spread over the surface, mm.

    The first end is the first vertex of the faces, each further one the farthest from those before. Two vertices that
    are near each other over the surface have nearly the same lengths; those of two lips that touch differ.
    """
    graph = edge_graph(vertices, faces)
    ways, end = np.empty((len(vertices), count)), faces[0, 0]
    nearest = np.where(np.isin(np.arange(len(vertices)), faces), np.inf, 0.0)  # a vertex of no face is never an end
    for k in range(count):
        ways[:, k] = np.minimum(dijkstra(graph, directed=False, indices=end), FAR_MM)
        nearest = np.minimum(nearest, ways[:, k])
        end = nearest.argmax()
    return ways


PAIRS_AT_ONCE = 4_000_000  # of points and triangles


@dataclass(frozen=True)
class Places:
    """Where k points lie on a triangle mesh.

    corners: (k, 3), the mesh's vertices around each. shares: (k, 3) float64, barycentric coordinates, non-negative,
    each row sums to 1.
    """

    corners: np.ndarray
    shares: np.ndarray

    def mix(self, values: Float[np.ndarray, "*b n d"]) -> Float[np.ndarray, "*b k d"]:
        """Return the mesh's values (n vertices, d numbers each) at the places, in the values' precision."""
        around = np.take(values, self.corners, axis=-2)  # (..., k, 3, d)
        return (around * self.shares[..., None].astype(values.dtype)).sum(-2)

    @property
    def nearest_corner(self) -> Int[np.ndarray, " k"]:
        """The vertex with the largest share in each place."""
        return np.take_along_axis(self.corners, self.shares.argmax(1)[:, None], axis=1)[:, 0]


def nearest_places(
    points: Float[np.ndarray, "k 3"],
    vertices: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "f 3"],
    directions: Float[np.ndarray, "k 3"] | None = None,
    lead: float = np.inf,
    nearby: Nearby | None = None,
) -> Places:
    """Return the place on a mesh that is nearest to each point; the arguments are those of `nearest_faces`."""
    chosen = nearest_faces(points, vertices, faces, directions, lead, nearby)
    corners = vertices[faces[chosen]].astype(np.float64)
    return Places(faces[chosen], closest_shares(points.astype(np.float64), corners))


def nearest_faces(
    points: Float[np.ndarray, "k 3"],
    vertices: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "f 3"],
    directions: Float[np.ndarray, "k 3"] | None = None,
    lead: float = np.inf,
    nearby: Nearby | None = None,
) -> Int[np.ndarray, " k"]:
    """Return the triangle of a mesh that is nearest to each point; exact, the first of several equally near.

    points: to place
    vertices: of the mesh
    faces: the mesh's triangles that a point may lie on
    directions: each point's normal; only triangles that face the same way are candidates, so that a point on the front
        of an ear never lands on its back; all triangles are where none faces that way
    lead: a triangle that faces another way is taken if it is nearer by more than this
    nearby: limits the candidates, so that a point of the upper lip never lands on the lower one
    """
    chosen = _nearest(points, vertices, faces, directions, nearby)
    if directions is None or np.isinf(lead):
        return chosen
    of_all = _nearest(points, vertices, faces, None, nearby)
    facing, any_way = (_distances(points, vertices[faces[indices]]) for indices in (chosen, of_all))
    return np.where(facing > any_way + lead, of_all, chosen)


def _nearest(
    points: np.ndarray, vertices: np.ndarray, faces: np.ndarray, directions: np.ndarray | None, nearby: Nearby | None
) -> Int[np.ndarray, " k"]:
    """Return the nearest triangle that is nearby and faces the same way; the nearest nearby where none faces it.

    A triangle lies within its radius of its centre, and its centre is one of its points: most are ruled out by that.
    """
    corners = vertices[faces].astype(np.float64)
    centres = corners.mean(1)
    radii = np.linalg.norm(corners - centres[:, None], axis=-1).max(1)
    normals = face_vectors(vertices.astype(np.float64), faces)
    ways = None if nearby is None else nearby.vertices[faces].mean(1)
    chosen = np.empty(len(points), np.int64)
    step = max(1, PAIRS_AT_ONCE // len(faces))
    for start in range(0, len(points), step):
        batch = np.asarray(points[start : start + step], np.float64)
        squared = (batch**2).sum(1)[:, None] - 2 * batch @ centres.T + (centres**2).sum(1)
        away = np.sqrt(np.maximum(squared, 0))  # (k, f), from point to centre
        if nearby is not None:
            apart = cdist(nearby.points[start : start + step], ways, "chebyshev")
            away[apart > np.maximum(apart.min(1, keepdims=True), nearby.reach)] = np.inf
        if directions is not None:
            left_out = np.isinf(away) | (directions[start : start + step] @ normals.T <= 0)
            away[left_out & ~left_out.all(1, keepdims=True)] = np.inf
        bound = away.min(1, keepdims=True)
        point, face = np.nonzero(away - radii <= bound * (1 + 1e-9) + 1e-9)
        distance = _distances(batch[point], corners[face])
        order = np.lexsort((face, distance, point))
        chosen[start : start + step] = face[order[np.searchsorted(point[order], np.arange(len(batch)))]]
    return chosen


def closest_shares(points: Float[np.ndarray, "k 3"], corners: Float[np.ndarray, "k 3 3"]) -> Float64[np.ndarray, "k 3"]:
    """Return the barycentric coordinates of the point of each triangle that is nearest to its point.

    corners: each point's triangle. Where the foot of the perpendicular lies outside, that is a point of an edge.
    """
    a, b, c = np.moveaxis(corners, 1, 0)
    shares = _plane_shares(points, a, b, c)
    outside = (shares < 0).any(1)
    if outside.any():
        best = np.full(len(points), np.inf)
        best[~outside] = -1
        for start, end in ((0, 1), (1, 2), (2, 0)):
            from_start, along = points - corners[:, start], corners[:, end] - corners[:, start]
            length = (along**2).sum(1)
            ratio = np.divide((from_start * along).sum(1), length, out=np.zeros(len(points)), where=length > 0)
            ratio = ratio.clip(0, 1)
            distance = ((from_start - ratio[:, None] * along) ** 2).sum(1)
            nearer = distance < best
            best[nearer] = distance[nearer]
            shares[nearer] = 0
            shares[nearer, start], shares[nearer, end] = 1 - ratio[nearer], ratio[nearer]
    return shares / shares.sum(1, keepdims=True)


def _plane_shares(points: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Return the barycentric coordinates of each point's foot in its triangle's plane; −1 without such a plane."""
    u, v, w = b - a, c - a, points - a
    uu, uv, vv = (u * u).sum(1), (u * v).sum(1), (v * v).sum(1)
    wu, wv = (w * u).sum(1), (w * v).sum(1)
    area = uu * vv - uv * uv
    flat = area <= 0
    area = np.where(flat, 1, area)
    second, third = (vv * wu - uv * wv) / area, (uu * wv - uv * wu) / area
    shares = np.stack([1 - second - third, second, third], axis=1)
    shares[flat] = -1
    return shares


def _distances(points: Float[np.ndarray, "k 3"], corners: Float[np.ndarray, "k 3 3"]) -> Float64[np.ndarray, " k"]:
    """Return how far each point is from its triangle."""
    points, corners = points.astype(np.float64), corners.astype(np.float64)
    nearest = (closest_shares(points, corners)[:, :, None] * corners).sum(1)
    return np.linalg.norm(nearest - points, axis=1)
