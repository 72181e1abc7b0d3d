"""Which vertices and parameters each network sees."""

import numpy as np
import pytest
from small_face import M, small_influence, small_mesh

from replicate.approximation.segments import coarse_segments, faces_touching, faces_within, segment_vertices
from replicate.base.exceptions import InputError


def test_every_vertex_outside_the_rigid_segments_is_in_exactly_one_segment():
    mesh = small_mesh()
    segments = coarse_segments(mesh, {2}, small_influence(mesh))
    assert [segment.name for segment in segments] == ["face", "neck"]
    np.testing.assert_array_equal(np.sort(segment_vertices(segments)), np.flatnonzero(mesh.segment != 2))
    for segment in segments:
        np.testing.assert_array_equal(segment.uv, mesh.uv[segment.vertices])


def test_a_segment_sees_the_parameters_that_move_one_of_its_vertices_and_no_others():
    mesh = small_mesh()
    influence = small_influence(mesh)
    influence[300, 11] = True  # one vertex of the neck
    face, neck = coarse_segments(mesh, {2}, influence)
    assert mesh.segment[300] == 1
    np.testing.assert_array_equal(face.parameters, range(8))
    np.testing.assert_array_equal(neck.parameters, [6, 7, 8, 9, 11])


def test_a_segment_that_nothing_moves_sees_all_parameters():
    mesh = small_mesh()
    *_, tooth = coarse_segments(mesh, set(), small_influence(mesh))
    assert len(tooth.parameters) == M


def test_faces_are_found_by_all_corners_or_by_any():
    faces = np.array([[0, 1, 2], [1, 2, 3], [3, 4, 5]], np.int32)
    np.testing.assert_array_equal(faces_within(faces, np.array([3, 2, 1]), 6), [[2, 1, 0]])
    np.testing.assert_array_equal(faces_touching(faces, np.array([0, 5]), 6), [True, False, True])


def test_a_mesh_of_rigid_segments_only_is_refused_in_one_sentence():
    mesh = small_mesh()
    with pytest.raises(InputError, match="expected a segment that deforms, got 3 rigid ones"):
        coarse_segments(mesh, {0, 1, 2}, small_influence(mesh))
    with pytest.raises(InputError, match=r"expected .* vertices, as the mesh has, got 5"):
        coarse_segments(mesh, {2}, small_influence(mesh)[:5])
