"""Discrete operators on a triangle mesh, built once with numpy and scipy: areas, gradients, Laplacians, neighbours.

Vertices are (n, 3) in mm, faces (f, 3); `submesh` numbers the vertices of a part of the mesh.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int
from scipy.sparse.csgraph import dijkstra


def submesh(
    faces: Int[np.ndarray, "f 3"], vertices: Int[np.ndarray, " s"], n: int
) -> tuple[Int[np.ndarray, "g 3"], Int[np.ndarray, " g"]]:
    """Return the faces whose corners are all in `vertices`, as places in that list, and the indices of these faces."""
    place = np.full(n, -1)
    place[vertices] = np.arange(len(vertices))
    inside = np.flatnonzero((place[faces] >= 0).all(axis=1))
    return place[faces[inside]], inside


def face_gradients(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]
) -> tuple[Float[np.ndarray, "f 3 3"], Float[np.ndarray, " f"]]:
    """Return the gradients of the three hat functions on each face, [face, corner, xyz] in 1/mm, and areas in mm²."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    double_area = np.linalg.norm(normal, axis=1)
    unit = normal / np.maximum(double_area, 1e-12)[:, None]
    opposite = np.stack([c - b, a - c, b - a], axis=1)
    gradients = np.cross(unit[:, None], opposite) / np.maximum(double_area, 1e-12)[:, None, None]
    return gradients, 0.5 * double_area


def vertex_areas(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, " n"]:
    """Return a third of the area of each vertex's faces (the lumped mass M), in mm²; at least 1e-6."""
    _, area = face_gradients(vertices, faces)
    return np.maximum(np.bincount(faces.ravel(), np.repeat(area / 3, 3), len(vertices)), 1e-6)


def stiffness(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> sp.csr_matrix:
    """Return the cotangent stiffness matrix K (n, n): positive semi-definite, rows sum to 0, no unit."""
    gradients, area = face_gradients(vertices, faces)
    local = np.einsum("fid,fjd->fij", gradients, gradients) * area[:, None, None]
    rows = np.repeat(faces, 3, axis=1).ravel()
    columns = np.tile(faces, (1, 3)).ravel()
    return sp.csr_matrix((local.ravel(), (rows, columns)), shape=(len(vertices),) * 2)


def adjacency(faces: Int[np.ndarray, "f c"], n: int) -> sp.csr_matrix:
    """Return the symmetric 0/1 matrix (n, n) of the edges of triangles or quads, without diagonals."""
    pairs = np.concatenate([np.stack([faces[:, k - 1], faces[:, k]], axis=1) for k in range(faces.shape[1])])
    pairs = np.concatenate([pairs, pairs[:, ::-1]])
    matrix = sp.csr_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    matrix.data[:] = 1.0
    return matrix


def padded_neighbours(graph: sp.csr_matrix, width: int) -> tuple[Int[np.ndarray, "n w"], Float[np.ndarray, "n w"]]:
    """Return each vertex's first `width` neighbours with weights 1/degree, padded with the vertex at weight 0."""
    n = graph.shape[0]
    degree = np.minimum(np.diff(graph.indptr), width)
    slots = np.arange(width)[None, :] < degree[:, None]
    index = np.broadcast_to(np.arange(n)[:, None], (n, width)).copy()
    take = graph.indptr[:-1, None] + np.arange(width)[None, :]
    index[slots] = graph.indices[take[slots]]
    weight = slots / np.maximum(degree, 1)[:, None]
    return index.astype(np.int32), weight.astype(np.float32)


def padded_rows(matrix: sp.csr_matrix) -> dict[str, np.ndarray]:
    """Return a sparse matrix (n, s) as "slots" and "weights", (w, n) each.

    Row i is Σ_k weights[k, i] · value[slots[k, i]]; rows are padded with weight 0 to the width w of the fullest one.
    """
    matrix = sp.csr_matrix(matrix)
    matrix.eliminate_zeros()
    count = np.diff(matrix.indptr)
    slots = np.zeros((count.max(initial=1), len(count)), np.int32)
    weights = np.zeros(slots.shape, np.float32)
    row = np.repeat(np.arange(len(count)), count)
    place = np.arange(len(row)) - matrix.indptr[row]
    slots[place, row], weights[place, row] = matrix.indices, matrix.data
    return {"slots": slots, "weights": weights}


def geodesic(
    vertices: Float[np.ndarray, "n 3"], graph: sp.csr_matrix, sources: Int[np.ndarray, " k"], limit_mm: float = np.inf
) -> Float[np.ndarray, " n"]:
    """Return each vertex's distance along edges to the nearest source, in mm; infinite beyond `limit_mm`."""
    edges = graph.tocoo()
    length = np.linalg.norm(vertices[edges.row] - vertices[edges.col], axis=1)
    weighted = sp.csr_matrix((length, (edges.row, edges.col)), shape=graph.shape)
    return dijkstra(weighted, indices=np.atleast_1d(sources), min_only=True, limit=limit_mm)


def smooth_values(values: np.ndarray, graph: sp.csr_matrix, passes: int, keep: np.ndarray | None = None) -> np.ndarray:
    """Return (n, …) values after `passes` of half-way neighbour averaging; rows where `keep` is true stay."""
    degree = np.maximum(np.asarray(graph.sum(axis=1)).ravel(), 1)
    average = sp.diags(1 / degree) @ graph
    result = values.astype(np.float64)
    for _ in range(passes):
        step = 0.5 * (result + average @ result)
        result = step if keep is None else np.where(keep if result.ndim == 1 else keep[:, None], result, step)
    return result


def vertex_normals(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "n 3"]:
    """Return area-weighted unit normals; vertices without area get a zero vector."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    total = np.stack([np.bincount(faces.ravel(), np.repeat(normal[:, d], 3), len(vertices)) for d in range(3)], axis=1)
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12)


def harmonic(
    graph: sp.csr_matrix, anchors: Int[np.ndarray, " k"], values: Float[np.ndarray, " k"]
) -> Float[np.ndarray, " n"]:
    """Return the function with `values` at `anchors` that everywhere else is the mean of its neighbours.

    Vertices that no path joins to an anchor get 0.
    """
    n = graph.shape[0]
    free = np.ones(n, bool)
    free[anchors] = False
    degree = np.asarray(graph.sum(axis=1)).ravel()
    # 1e-9 keeps islands solvable and pulls them to 0; elsewhere its effect is lost in rounding.
    laplacian = (sp.diags(degree + 1e-9) - graph).tocsr()
    result = np.zeros(n)
    result[anchors] = values
    right = -laplacian[free][:, ~free] @ result[~free]
    result[free] = sp.linalg.spsolve(laplacian[free][:, free].tocsc(), right)
    return result
