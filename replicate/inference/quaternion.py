"""The best rotation of one 3×3 matrix as a unit quaternion, compiled: the eigenvector of Horn's 4×4 matrix.

It is a rotation by construction, never a reflection (Horn 1987, "Closed-form solution of absolute orientation using
unit quaternions"). Where the largest eigenvalue stands well apart from the others, it is a root that Newton's method
finds (Theobald 2005, "Rapid calculation of RMSDs using a quaternion-based characteristic polynomial"); elsewhere
Jacobi's rotations find all of them.
"""

from typing import no_type_check

import numpy as np
from numba import njit

from replicate.engine.jit_cache import KEEP_CODE

SWEEPS = 20  # at most, of Jacobi's rotations; four or five do
ENOUGH = 1e-30  # the squares beside the diagonal over those on it, where the last sweep is
STEPS = 30  # at most, of Newton's method; six to ten do
APART = 1e-2  # the slope at the root, the product of its distances to the others: beyond it the root is exact


@njit(cache=KEEP_CODE, error_model="numpy", nogil=True)
@no_type_check
def _turn(a, vectors, p, q):
    """Take a symmetric 4×4 matrix's entry (p, q) away by a rotation of both axes (Jacobi), and turn `vectors` along."""
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


@njit(cache=KEEP_CODE, error_model="numpy", nogil=True)
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


@njit(cache=KEEP_CODE, error_model="numpy", nogil=True)
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


@njit(cache=KEEP_CODE, error_model="numpy", nogil=True)
@no_type_check
def _first_by_newton(m, a, q):
    """Write the first eigenvector of `_horn`'s matrix to q, not of unit length; return whether it stands well apart.

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


@njit(cache=KEEP_CODE, error_model="numpy", nogil=True)
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


@njit(cache=KEEP_CODE, error_model="numpy", nogil=True)
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
