"""The compiled vertex normals against the clear ones, on poses and on faces that have none."""

import numpy as np
import pytest
from small_face import pose_offsets, small_mesh

from replicate.geometry.mesh import vertex_normals
from replicate.inference.vertex_normals import fast_vertex_normals

MESH = small_mesh()
ROUNDING = 1e-5


def test_every_pose_has_the_normals_of_the_clear_way():
    rng = np.random.default_rng(0)
    for offsets in pose_offsets(MESH, rng.uniform(-1, 1, (20, 12))):
        posed = (MESH.neutral + offsets + rng.normal(size=offsets.shape)).astype(np.float32)
        fast, clear = fast_vertex_normals(posed, MESH.faces), vertex_normals(posed, MESH.faces)
        assert fast.dtype == np.float32
        np.testing.assert_allclose(fast, clear, atol=ROUNDING)
        np.testing.assert_allclose(np.linalg.norm(fast, axis=1), 1, atol=ROUNDING)


def test_a_large_face_counts_for_more_than_a_small_one():
    vertices = np.array([[0, 0, 0], [3, 0, 0], [0, 1, 0], [0, 0, 4]], np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]])  # of 1.5 along z and of 2 along x
    np.testing.assert_allclose(fast_vertex_normals(vertices, faces)[0], [0.8, 0, 0.6], atol=ROUNDING)


@pytest.mark.parametrize("dtype", [np.int32, np.int64])
def test_vertices_without_a_face_or_an_area_have_the_zero_vector(dtype):
    vertices = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [9, 9, 9]], np.float32)
    normals = fast_vertex_normals(vertices, np.array([[0, 1, 2]], dtype))
    np.testing.assert_array_equal(normals, 0)
