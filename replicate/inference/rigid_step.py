"""The rigid step of one pose (§3.4), compiled: the best rotations by quaternions, written over the rigid segments.

`geometry.alignment.align` takes the singular values of a stack of 3×3 matrices; in NumPy one pose of a hundred teeth
costs more than all else. The matrix whose rotation is sought is made regular as there, so that points which leave a
freedom turn the same way.
"""

from typing import NamedTuple, no_type_check

import numpy as np
from numba import njit

from replicate.approximation.rigid import Attachments
from replicate.base.jit_cache import kept
from replicate.geometry.mesh import Mesh

REGULAR = 1e-12  # of a matrix's size along the identity, as in `alignment.nearest_rotation`


class RigidPlan(NamedTuple):
    """r rigid segments with c carriers each, and k vertices in all of them.

    carriers: (r, c), vertices of the mesh.
    rest: (r, c, 3), the carriers' places at rest, relative to their mean.
    centres: (r, 3), that mean.
    members: (k,), the segments' vertices, one segment after the other.
    places: (k, 3), where these are at rest.
    ends: (r,), where each segment ends among them.
    """

    carriers: np.ndarray
    rest: np.ndarray
    centres: np.ndarray
    members: np.ndarray
    places: np.ndarray
    ends: np.ndarray


def plan_rigid_step(mesh: Mesh, attachments: Attachments) -> RigidPlan:
    """Return the plan of a mesh's rigid step."""
    carriers = np.asarray(attachments.vertex, np.int64)
    rest = mesh.neutral[carriers].astype(np.float64)
    centres = rest.mean(1) if len(carriers) else np.zeros((0, 3))
    members = [np.flatnonzero(mesh.segment == k) for k in attachments.segment]
    all_members = np.concatenate([*members, np.zeros(0, np.int64)])
    ends = np.cumsum([len(vertices) for vertices in members], dtype=np.int64)
    places = mesh.neutral[all_members].astype(np.float64)
    return RigidPlan(carriers, rest - centres[:, None], centres, all_members, places, ends)


@kept
@njit(error_model="numpy", nogil=True)
@no_type_check
def place_rigid_segments(plan: RigidPlan, posed: np.ndarray) -> None:
    """Write the vertices of rigid segments to a posed mesh (n, 3), float32 mm, where their carriers have moved them."""
    m, a, vectors = np.empty((3, 3)), np.empty((4, 4)), np.empty((4, 4))
    q, centre = np.empty(4), np.empty(3)
    start = 0
    for row in range(len(plan.ends)):
        count = plan.carriers.shape[1]
        centre[:] = 0.0
        for k in range(count):
            for j in range(3):
                centre[j] += posed[plan.carriers[row, k], j]
        centre /= count
        m[:] = 0.0
        for k in range(count):
            for i in range(3):
                for j in range(3):
                    m[i, j] += plan.rest[row, k, i] * (posed[plan.carriers[row, k], j] - centre[j])
        size = 0.0
        for i in range(3):
            for j in range(3):
                size += m[i, j] * m[i, j]
        if size > 0:
            m /= np.sqrt(size)
        for j in range(3):
            m[j, j] += REGULAR
        best_quaternion(m, a, vectors, q)
        w, x, y, z = q[0], q[1], q[2], q[3]
        xx, yx, zx = w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)
        xy, yy, zy = 2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)
        xz, yz, zz = 2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z
        ox, oy, oz = plan.centres[row, 0], plan.centres[row, 1], plan.centres[row, 2]
        tx = centre[0] - ox * xx - oy * yx - oz * zx
        ty = centre[1] - ox * xy - oy * yy - oz * zy
        tz = centre[2] - ox * xz - oy * yz - oz * zz
        for k in range(start, plan.ends[row]):
            px, py, pz = plan.places[k, 0], plan.places[k, 1], plan.places[k, 2]
            vertex = plan.members[k]
            posed[vertex, 0] = px * xx + py * yx + pz * zx + tx
            posed[vertex, 1] = px * xy + py * yy + pz * zy + ty
            posed[vertex, 2] = px * xz + py * yz + pz * zz + tz
        start = plan.ends[row]


# The best rotation of one 3×3 matrix as a unit quaternion, compiled: the eigenvector of Horn's 4×4 matrix.

SWEEPS = 20  # at most, of Jacobi's rotations; four or five do
ENOUGH = 1e-30  # squares beside the diagonal over those on it, at which sweeps end
STEPS = 30  # at most, of Newton's method; six to ten do
APART = 1e-2  # the slope at the root, which is the product of its distances to the others: above it the root is exact


@kept
@njit(error_model="numpy", nogil=True)
@no_type_check
def _turn(a, vectors, p, q):
    """Turn the axes p and q so that a symmetric 4×4 matrix's entry (p, q) becomes zero (Jacobi); `vectors` turn too."""
    if a[p, q] == 0.0:
        return
    height = a[q, q] - a[p, p]
    twice = 2 * a[p, q]
    tangent = twice / (abs(height) + np.sqrt(height * height + twice * twice))
    if height < 0:
        tangent = -tangent
    c = 1 / np.sqrt(1 + tangent * tangent)
    s = tangent * c
    for k in range(4):
        left, right = a[k, p], a[k, q]
        a[k, p], a[k, q] = c * left - s * right, s * left + c * right
    for k in range(4):
        left, right = a[p, k], a[q, k]
        a[p, k], a[q, k] = c * left - s * right, s * left + c * right
        left, right = vectors[k, p], vectors[k, q]
        vectors[k, p], vectors[k, q] = c * left - s * right, s * left + c * right


@kept
@njit(error_model="numpy", nogil=True)
@no_type_check
def _horn(m, a):
    """Write to a (4, 4) the matrix whose first eigenvector is the quaternion of the R with the largest tr(Rᵀ m)."""
    a[0, 0], a[1, 1] = m[0, 0] + m[1, 1] + m[2, 2], m[0, 0] - m[1, 1] - m[2, 2]
    a[2, 2], a[3, 3] = m[1, 1] - m[0, 0] - m[2, 2], m[2, 2] - m[0, 0] - m[1, 1]
    a[0, 1], a[0, 2], a[0, 3] = m[1, 2] - m[2, 1], m[2, 0] - m[0, 2], m[0, 1] - m[1, 0]
    a[1, 2], a[1, 3], a[2, 3] = m[0, 1] + m[1, 0], m[2, 0] + m[0, 2], m[1, 2] + m[2, 1]
    for i in range(4):
        for j in range(i):
            a[i, j] = a[j, i]


@kept
@njit(error_model="numpy", nogil=True)
@no_type_check
def _normal(a, row, q):
    """Write to q (4,) a vector at right angles to all rows of a (4, 4) but one; return its squared length."""
    r, s, t = (row + 1) % 4, (row + 2) % 4, (row + 3) % 4
    length = 0.0
    for k in range(4):
        i, j, l = (k + 1) % 4, (k + 2) % 4, (k + 3) % 4  # noqa: E741
        minor = a[r, i] * (a[s, j] * a[t, l] - a[s, l] * a[t, j])
        minor -= a[r, j] * (a[s, i] * a[t, l] - a[s, l] * a[t, i])
        minor += a[r, l] * (a[s, i] * a[t, j] - a[s, j] * a[t, i])
        q[k] = minor if k % 2 == 0 else -minor
        length += minor * minor
    return length


@kept
@njit(error_model="numpy", nogil=True)
@no_type_check
def _first_by_newton(m, a, q):
    """Write the first eigenvector of `_horn`'s matrix to q, not of unit length; return whether it is exact enough.

    m is of unit size: the eigenvalue is the largest root of λ⁴ − 2 ‖m‖² λ² − 8 det(m) λ + det(a), at most √3.
    """
    square, determinant = 0.0, 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        square += m[i, 0] * m[i, 0] + m[i, 1] * m[i, 1] + m[i, 2] * m[i, 2]
        determinant += m[0, i] * (m[1, j] * m[2, k] - m[1, k] * m[2, j])
    c2, c1 = -2 * square, -8 * determinant
    _normal(a, 0, q)
    c0 = a[0, 0] * q[0] + a[0, 1] * q[1] + a[0, 2] * q[2] + a[0, 3] * q[3]
    root, slope = np.sqrt(3 * square), 0.0
    for _ in range(STEPS):
        slope = (4 * root * root + 2 * c2) * root + c1
        step = (((root * root + c2) * root + c1) * root + c0) / slope
        root -= step
        if not abs(step) > 1e-15 * root:
            break
    if not slope > APART:
        return False
    for k in range(4):
        a[k, k] -= root
    for row in range(4):  # a row of the adjugate is its entry of the unit vector times the vector, times the slope
        if 8 * _normal(a, row, q) > slope * slope:
            return True
    return False


@kept
@njit(error_model="numpy", nogil=True)
@no_type_check
def _first_by_jacobi(a, vectors, q):
    """Write the first eigenvector of `_horn`'s matrix to q; the matrix becomes diagonal."""
    for i in range(4):
        for j in range(4):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(SWEEPS):
        on, beside = 0.0, 0.0
        for i in range(4):
            on += a[i, i] * a[i, i]
            for j in range(i):
                beside += a[i, j] * a[i, j]
        if beside <= ENOUGH * on:
            break
        for i in range(3):
            for j in range(i + 1, 4):
                _turn(a, vectors, i, j)
    best = 0
    for k in range(1, 4):
        if a[k, k] > a[best, best]:
            best = k
    for k in range(4):
        q[k] = vectors[k, best]


@kept
@njit(error_model="numpy", nogil=True)
@no_type_check
def best_quaternion(m: np.ndarray, a: np.ndarray, vectors: np.ndarray, q: np.ndarray) -> None:
    """Write to q (4,) the unit quaternion of the rotation R that maximises tr(Rᵀ m), rotations acting on rows.

    m (3, 3) is of unit size, or near it. a, vectors: scratch, (4, 4).
    """
    _horn(m, a)
    if not _first_by_newton(m, a, q):
        _horn(m, a)
        _first_by_jacobi(a, vectors, q)
    q /= np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
