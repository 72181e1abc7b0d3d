"""The mesh: closed forms on a box and a tetrahedron, and one sentence for each thing that can be wrong with it."""

import numpy as np
import pytest

from replicate.base.exceptions import InputError
from replicate.geometry.mesh import Mesh, edges, face_normals, face_vectors, vertex_normals

TETRAHEDRON = np.array([[0, 0, 0], [3, 0, 0], [0, 4, 0], [0, 0, 5]], np.float32)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32)
UV = np.array([[0, 0], [1, 0], [0, 1], [0.5, 0.5]], np.float32)


def tetrahedron(**changes) -> Mesh:
    segment = np.zeros(4, np.int32)
    parts = {
        "neutral": TETRAHEDRON,
        "faces": FACES,
        "uv": UV,
        "segment": segment,
        "segment_names": ("skin",),
    }
    return Mesh(**(parts | changes))


def test_face_normals_and_areas_of_a_tetrahedron_are_the_closed_form():
    slanted = np.array([20, 15, 12]) / np.sqrt(20**2 + 15**2 + 12**2)
    np.testing.assert_allclose(
        face_normals(TETRAHEDRON, FACES),
        [[0, 0, -1], [0, -1, 0], [-1, 0, 0], slanted],
        atol=1e-7,
    )
    areas = np.linalg.norm(face_vectors(TETRAHEDRON, FACES), axis=-1) / 2
    np.testing.assert_allclose(areas, [6, 7.5, 10, np.sqrt(769) / 2], rtol=1e-6)


def test_leading_batch_dimensions_pass_through():
    rng = np.random.default_rng(0)
    poses = TETRAHEDRON + rng.normal(size=(2, 3, 4, 3)).astype(np.float32)
    for function in (face_normals, face_vectors, vertex_normals):
        together = function(poses, FACES)
        assert together.dtype == np.float32
        apart = np.stack([[function(pose, FACES) for pose in row] for row in poses])
        np.testing.assert_array_equal(together, apart)


def test_face_normals_leave_their_argument_alone():
    vertices = TETRAHEDRON.copy()
    face_normals(vertices, FACES)
    np.testing.assert_array_equal(vertices, TETRAHEDRON)


def test_vertex_normals_of_a_box_corner_point_along_its_diagonal():
    corner = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2]], np.int32)
    np.testing.assert_allclose(vertex_normals(corner, faces)[0], -np.ones(3) / np.sqrt(3), atol=1e-6)


def test_a_face_that_collapses_in_a_pose_gets_a_zero_normal_and_no_nan():
    pose = TETRAHEDRON.copy()
    pose[1] = pose[0]
    normals = face_normals(pose, FACES)
    assert np.isfinite(normals).all()
    assert (normals[0] == 0).all() and (normals[1] == 0).all()


def test_edges_name_every_edge_once():
    np.testing.assert_array_equal(edges(FACES), [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])


def test_a_face_belongs_to_the_segment_of_two_of_its_vertices():
    mesh = tetrahedron(segment=np.array([0, 1, 1, 2], np.int32), segment_names=("a", "b", "c"))
    np.testing.assert_array_equal(mesh.face_segment, [1, 0, 0, 1])


def with_value(array, index, value):
    copy = array.astype(array.dtype, copy=True)
    copy[index] = value
    return copy


@pytest.mark.parametrize(
    "changes, sentence",
    [
        (
            {"uv": with_value(UV, (2, 1), 1.5)},
            r"uv\[2\]: expected values in \[0, 1\], got \[0.0, 1.5\]",
        ),
        ({"uv": with_value(UV, (1, 0), np.nan)}, r"uv\[1\]: .* got \[nan, 0.0\]"),
        (
            {"neutral": with_value(TETRAHEDRON, (3, 2), np.nan)},
            r"neutral\[3\]: expected finite .* got \[0.0, 0.0, nan\]",
        ),
        ({"faces": with_value(FACES, (1, 2), 4)}, r"faces\[1\]: expected .*0 to 3, got \[0, 1, 4\]"),
        ({"faces": with_value(FACES, (0, 0), -1)}, r"faces\[0\]: .* got \[-1, 2, 1\]"),
        (
            {"faces": with_value(FACES, (3, 1), 1)},
            r"faces\[3\]: expected a face with an area, got \[1, 1, 3\]",
        ),
        (
            {"neutral": with_value(TETRAHEDRON, 3, [1.5, 0, 0])},
            r"faces\[1\]: expected a face with an area, got \[0, 1, 3\]",
        ),
        (
            {"segment": np.array([0, 0, -1, 0], np.int32)},
            r"vertex 2 is in no segment.*0 to 0, got -1",
        ),
        ({"segment": np.array([0, 0, 0, 1], np.int32)}, r"vertex 3 is in no segment"),
        ({"segment_names": ("skin", "ear")}, r"segment 1 \('ear'\): expected at least one vertex"),
        ({"uv": UV[:3]}, r"uv: expected the shape \(4, 2\), got \(3, 2\)"),
        (
            {"faces": FACES.astype(np.float32)},
            r"faces: expected integers, got float32",
        ),
    ],
)
def test_a_bad_mesh_is_refused_with_one_sentence(changes, sentence):
    with pytest.raises(InputError, match=sentence) as error:
        tetrahedron(**changes)
    assert str(error.value).startswith("mesh: ") and "\n" not in str(error.value)


def test_a_mesh_comes_back_from_disk_as_it_was(tmp_path):
    mesh = tetrahedron(segment=np.array([0, 1, 1, 2], np.int32), segment_names=("Gesicht", "øre", "c"))
    mesh.save(tmp_path / "a.npz")
    mesh.save(tmp_path / "b.npz")
    back = Mesh.load(tmp_path / "a.npz")
    assert back.segment_names == mesh.segment_names
    for name in ("neutral", "faces", "uv", "segment"):
        np.testing.assert_array_equal(getattr(back, name), getattr(mesh, name))
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
