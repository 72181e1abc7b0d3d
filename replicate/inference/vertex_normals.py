"""The vertex normals of one pose, compiled: while a point is dragged, every update of the mesh needs them.

`geometry.mesh.vertex_normals` is the clear way. Here each face is read once and adds its normal, as long as twice
its area, to its three corners.
"""

from typing import no_type_check

import numpy as np
from jaxtyping import Float32, Int
from numba import njit

from replicate.base.jit_cache import kept


def fast_vertex_normals(
    vertices: Float32[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"]
) -> Float32[np.ndarray, "n 3"]:
    """Return each vertex's unit normal as `vertex_normals` does, on one thread: its faces' mean, weighted by area.

    The normal is zero where a vertex has no face, or where its faces have no area or cancel out.
    """
    out = np.empty_like(vertices)
    _write_normals(vertices, faces, np.zeros(vertices.shape, np.float64), out)
    return out


@kept
@njit(error_model="numpy", nogil=True)
@no_type_check
def _write_normals(vertices, faces, sums, out):
    """Write the normals to `out` (n, 3). sums: zeros (n, 3) float64, so that the order of faces hardly matters."""
    for face in range(len(faces)):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        ux, uy, uz = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1], vertices[b, 2] - vertices[a, 2]
        vx, vy, vz = vertices[c, 0] - vertices[a, 0], vertices[c, 1] - vertices[a, 1], vertices[c, 2] - vertices[a, 2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        for corner in (a, b, c):
            sums[corner, 0] += x
            sums[corner, 1] += y
            sums[corner, 2] += z
    for k in range(len(sums)):
        length = np.sqrt(sums[k, 0] ** 2 + sums[k, 1] ** 2 + sums[k, 2] ** 2)
        scale = 1.0 / length if length > 0 else 0.0
        for axis in range(3):
            out[k, axis] = sums[k, axis] * scale
