"""Ways over a surface, along the edges of its mesh: two lips that touch are far apart by them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Int
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from replicate.geometry.edges import edges

ENDS = 12  # of the ways that tell where on a surface a vertex is
FAR_MM = 1_000.0  # the longest way that counts, and that between two parts which no edge joins


@dataclass(frozen=True)
class Nearby:
    """Which triangles of a mesh each of k points may be put on: those from which ways over the surface are as long.

    points: (k, e), vertices: (n, e), the lengths of the ways to the same e places, as `surface_ways` gives them, mm.
    reach: by how much the length of any of them may differ, mm; where all triangles differ by more, the least is taken.
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
    """Return the length of the shortest way from each vertex to some that are spread over the surface, mm.

    The first is the first of the faces' vertices, each further one the farthest from those before. Two vertices that
    are near each other over the surface have nearly the same lengths; two lips that touch have not.
    """
    graph = edge_graph(vertices, faces)
    ways, end = np.empty((len(vertices), count)), faces[0, 0]
    nearest = np.where(np.isin(np.arange(len(vertices)), faces), np.inf, 0.0)  # what no face has is never an end
    for k in range(count):
        ways[:, k] = np.minimum(dijkstra(graph, directed=False, indices=end), FAR_MM)
        nearest = np.minimum(nearest, ways[:, k])
        end = nearest.argmax()
    return ways
