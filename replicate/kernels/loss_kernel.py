"""Eq. 1 and its gradient in one pass over the faces, eight poses at a time: the fast twin of `losses.reference_loss`.

Arrays are (n, 3, LANES): the eight poses of a batch lie side by side, so that each step of the inner loops is one
vector instruction. All that a face needs is gathered into one small buffer first; the compiler then sees that the
inner loops neither overlap nor depend on each other.
"""

from typing import no_type_check

import numba
import numpy as np

from replicate.base.jit_cache import kept

LANES = 8
_BUFFER = 28 * LANES


@kept
@numba.njit(error_model="numpy")
@no_type_check
def loss_and_gradient(
    vertices: np.ndarray, target: np.ndarray, faces: np.ndarray, vertex_scale: float, normal_scale: float
) -> tuple[float, np.ndarray]:
    """Return the summed Eq. 1 of all lanes and its gradient, (n, 3, LANES), in the vertices.

    vertices, target: (n, 3, LANES) float32, mm. faces: (f, 3) int32. The two scales multiply the sums of absolute
    differences of positions and of normals. Lanes where both meshes agree add nothing. Sums over the mesh are double.
    """
    gradient, total = _vertex_term(vertices.ravel(), target.ravel(), np.float32(vertex_scale))
    total += _normal_term(vertices.ravel(), target.ravel(), faces, np.float32(normal_scale), gradient)
    return total, gradient.reshape(vertices.shape)


@kept
@numba.njit(error_model="numpy")
@no_type_check
def _vertex_term(vertices, target, scale):
    gradient = np.empty_like(vertices)
    sums = np.zeros(LANES, np.float64)
    for row in range(0, len(vertices), LANES):
        for lane in range(LANES):
            difference = vertices[row + lane] - target[row + lane]
            sums[lane] += abs(difference)
            gradient[row + lane] = np.float32(difference > 0) * scale - np.float32(difference < 0) * scale
    return gradient, sums.sum() * scale


@kept
@numba.njit(error_model="numpy")
@no_type_check
def _normal_term(vertices, target, faces, scale, gradient):
    sums = np.zeros(LANES, np.float64)
    w = np.empty(_BUFFER, np.float32)  # rows: 0–8 corners, 9–17 true ones, 18–26 gradients, 27 loss
    for f in range(len(faces)):
        for corner in range(3):
            first = faces[f, corner] * (3 * LANES)
            for k in range(3 * LANES):
                w[corner * 3 * LANES + k] = vertices[first + k]
                w[(9 + corner * 3) * LANES + k] = target[first + k]
        for i in range(LANES):
            ax, ay, az = _edge(w, 0, 3, i)
            bx, by, bz = _edge(w, 0, 6, i)
            nx, ny, nz, inverse = _unit(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)
            cx, cy, cz = _edge(w, 9, 12, i)
            dx, dy, dz = _edge(w, 9, 15, i)
            tx, ty, tz, _ = _unit(cy * dz - cz * dy, cz * dx - cx * dz, cx * dy - cy * dx)
            ex, ey, ez = nx - tx, ny - ty, nz - tz
            w[27 * LANES + i] = abs(ex) + abs(ey) + abs(ez)
            # d|n − ñ|/dn, then through the normalisation: (I − n nᵀ) s / |a × b|
            sx = np.float32(ex > 0) - np.float32(ex < 0)
            sy = np.float32(ey > 0) - np.float32(ey < 0)
            sz = np.float32(ez > 0) - np.float32(ez < 0)
            along = sx * nx + sy * ny + sz * nz
            inverse = inverse * scale
            gx, gy, gz = (sx - along * nx) * inverse, (sy - along * ny) * inverse, (sz - along * nz) * inverse
            # and through the cross product: d/da = b × g, d/db = g × a
            ux, uy, uz = by * gz - bz * gy, bz * gx - bx * gz, bx * gy - by * gx
            vx, vy, vz = gy * az - gz * ay, gz * ax - gx * az, gx * ay - gy * ax
            w[18 * LANES + i], w[19 * LANES + i], w[20 * LANES + i] = -ux - vx, -uy - vy, -uz - vz
            w[21 * LANES + i], w[22 * LANES + i], w[23 * LANES + i] = ux, uy, uz
            w[24 * LANES + i], w[25 * LANES + i], w[26 * LANES + i] = vx, vy, vz
        for i in range(LANES):
            sums[i] += w[27 * LANES + i]
        for corner in range(3):
            first = faces[f, corner] * (3 * LANES)
            for k in range(3 * LANES):
                gradient[first + k] += w[(18 + corner * 3) * LANES + k]
    return sums.sum() * scale


@kept
@numba.njit(inline="always", error_model="numpy")
@no_type_check
def _edge(w, start, end, lane):
    """Return the vector between the corners whose coordinates begin at two rows of the buffer."""
    a, b = start * LANES + lane, end * LANES + lane
    return w[b] - w[a], w[b + LANES] - w[a + LANES], w[b + 2 * LANES] - w[a + 2 * LANES]


@kept
@numba.njit(inline="always", error_model="numpy")
@no_type_check
def _unit(x, y, z):
    """Return a vector's direction and one over its length; zeros for a vector of no length."""
    squared = x * x + y * y + z * z
    present = squared > np.float32(0)
    inverse = np.float32(present) / np.sqrt(squared if present else np.float32(1))
    return x * inverse, y * inverse, z * inverse, inverse
