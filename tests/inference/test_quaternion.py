"""Compiled quaternions against singular values."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from replicate.geometry.alignment import nearest_rotation
from replicate.inference.rigid_step import best_quaternion


@pytest.mark.parametrize(
    "sizes", [(1, 0.5, 0.2), (1, 0.3, 0), (1, 1e-4, 1e-5), (1, 1e-7, 0), (1, 0.5, -0.2), (1, 1, 1)]
)
def test_quaternions_are_the_rotations_of_singular_values(sizes):
    rng = np.random.default_rng(3)
    a, vectors, q = np.empty((4, 4)), np.empty((4, 4)), np.empty(4)
    for _ in range(50):
        left, right = (Rotation.random(random_state=rng).as_matrix() for _ in range(2))
        m = left * (np.array(sizes) / np.linalg.norm(sizes)) @ right
        best_quaternion(m + 1e-12 * np.eye(3), a, vectors, q)
        turn = Rotation.from_quat(q[[1, 2, 3, 0]]).as_matrix().T  # acting on rows
        np.testing.assert_allclose(turn, nearest_rotation(m), atol=1e-8)
