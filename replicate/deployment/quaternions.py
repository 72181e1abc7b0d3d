"""Unit quaternions (w, x, y, z) by linear maps: what Horn's matrix, rotations and products are in terms of entries."""

from itertools import product

import numpy as np
from jaxtyping import Float


def axial(covariance: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3"]:
    """Return Σ x × y for the matrix Σ xᵀ y of row vectors."""
    s = covariance
    return np.array([s[1, 2] - s[2, 1], s[2, 0] - s[0, 2], s[0, 1] - s[1, 0]])


def horn_matrix(covariance: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "4 4"]:
    """Return Horn's symmetric matrix for Σ xᵀ y: its last eigenvector turns x best to y (Eq. 3)."""
    s, matrix = covariance, np.empty((4, 4))
    matrix[0, 0] = np.trace(s)
    matrix[0, 1:] = matrix[1:, 0] = axial(s)
    matrix[1:, 1:] = s + s.T - np.trace(s) * np.eye(3)
    return matrix


def rotation_of(quaternion: Float[np.ndarray, "4"]) -> Float[np.ndarray, "3 3"]:
    """Return the rotation of row vectors, v @ R, that a unit quaternion is."""
    w, (x, y, z) = quaternion[0], quaternion[1:]
    v = quaternion[1:]
    across = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])
    return (w * w - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * w * across


def quaternion_product(one: Float[np.ndarray, "4"], other: Float[np.ndarray, "4"]) -> Float[np.ndarray, "4"]:
    """Return the quaternion that turns as `other` and then as `one`."""
    a, b = one, other
    vector = a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])
    return np.array([a[0] * b[0] - a[1:] @ b[1:], *vector])


def _bilinear(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (rotation_of(a + b) - rotation_of(a) - rotation_of(b)) / 2


_UNITS = np.eye(4)
HORN = np.array([horn_matrix(s).ravel() for s in np.eye(9).reshape(9, 3, 3)])  # (9, 16): Σ xᵀ y, row by row → matrix
FROM_PRODUCTS = np.array([_bilinear(a, b).ravel() for a, b in product(_UNITS, _UNITS)])  # (16, 9): q_i q_j → rotation
PRODUCT = np.array([quaternion_product(a, b) for a, b in product(_UNITS, _UNITS)])  # (16, 4): a_i b_j → a b
