"""Cameras: what projection must do, whoever draws."""

import numpy as np
import pytest
from plane import flat_grid

from replicate.drawing.scene import (
    CAMERAS,
    HEAD_WIDTH_MM,
    Camera,
    Surface,
    axes,
    camera_for,
    faces_in_view,
    forehead_camera,
    forehead_faces,
    frame_surfaces,
    project,
)

HEAD = np.float32([[-HEAD_WIDTH_MM / 2, 0, 0], [HEAD_WIDTH_MM / 2, 0, 0]])


@pytest.mark.parametrize("name", CAMERAS)
def test_a_camera_sees_its_focus_in_the_middle_and_its_height_from_edge_to_edge(name):
    camera = camera_for(name, HEAD)
    right, up, _ = axes(camera)[0]
    focus = np.array(camera.focus)
    points = np.stack([focus, focus + up * camera.height_mm / 2, focus + right * camera.height_mm / 2])
    pixels, depth = project(points, camera, 400, 200)
    np.testing.assert_allclose(pixels, [[200, 100], [200, 0], [300, 100]], atol=1e-9)
    np.testing.assert_allclose(depth, camera.distance_mm)


def test_the_cameras_axes_are_a_right_handed_frame():
    rows, _ = axes(Camera((0, 0, 0), 100, 35, 20))
    np.testing.assert_allclose(rows @ rows.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rows) == pytest.approx(1)


def test_from_the_right_the_face_looks_to_the_left_of_the_picture():
    nose, ear = np.array([[0.0, 0, 100], [75, 0, 0]])
    (nose_x, _), (ear_x, _) = project(np.stack([nose, ear]), Camera((0, 0, 0), 300, 80), 300, 300)[0]
    assert nose_x < ear_x


def test_a_head_twice_as_large_looks_the_same():
    points = np.random.default_rng(0).normal(size=(20, 3)) * 40
    small, large = camera_for("front", HEAD), camera_for("front", 2 * HEAD)
    np.testing.assert_allclose(project(points, small, 100, 100)[0], project(2 * points, large, 100, 100)[0], atol=1e-9)


def test_shoulders_do_not_change_a_camera():
    bust = np.concatenate([HEAD, np.float32([[-150, -180, 0], [150, -180, 0]])])
    assert camera_for("front", bust) == camera_for("front", HEAD)


def test_a_camera_makes_no_room_for_what_may_leave_the_picture():
    faces = np.int32([[0, 1, 1]])
    head, camera = Surface(HEAD, faces), camera_for("front", HEAD)
    assert frame_surfaces(camera, [head, Surface(3 * HEAD, faces, framed=False)], 1) == frame_surfaces(
        camera, [head], 1
    )
    assert frame_surfaces(camera, [head, Surface(3 * HEAD, faces)], 1) != frame_surfaces(camera, [head], 1)


def test_only_faces_in_the_frame_and_turned_to_the_camera_are_in_view():
    triangle = np.float32([[0, 0, 0], [10, 0, 0], [0, 10, 0]])
    vertices = np.concatenate([triangle, triangle + np.float32([500, 0, 0])])
    faces = np.int32([[0, 1, 2], [0, 2, 1], [3, 4, 5]])
    assert faces_in_view(vertices, faces, Camera((0, 0, 0), 100)).tolist() == [True, False, False]


def plate(low, high, n=30):
    """An upright plate, as wide as a head, between two heights."""
    return flat_grid(np.linspace(-HEAD_WIDTH_MM / 2, HEAD_WIDTH_MM / 2, n), np.linspace(low, high, n), 75)


def test_the_forehead_lies_between_brow_and_hair():
    vertices, faces = plate(-130, 120)
    height = vertices[faces[forehead_faces(vertices, faces)]][..., 1]
    assert 20 < height.min() < 45 and 75 < height.max() < 100


def test_without_a_forehead_everything_in_front_counts():
    vertices, faces = plate(-130, -40)
    assert forehead_faces(vertices, faces).mean() > 0.5


def test_the_camera_on_the_forehead_follows_where_a_pose_takes_it():
    vertices, faces = plate(-130, 120)
    moved = vertices + np.float32([25, -12, 8])
    still, following = (forehead_camera(vertices, faces, posed) for posed in (vertices, moved))
    assert still == camera_for("forehead", vertices)
    middle = vertices[np.unique(faces[forehead_faces(vertices, faces)])].mean(0, keepdims=True).astype(float)
    there = middle + np.array([25, -12, 8])
    np.testing.assert_allclose(project(there, following, 100, 100)[0], project(middle, still, 100, 100)[0], atol=1e-3)


def test_the_camera_on_the_forehead_looks_lower_where_there_is_no_more_of_it():
    for top, expected in ((120, 0.0), (60, 0.0)):
        vertices, faces = plate(-130, top)
        camera = forehead_camera(vertices, faces, vertices)
        own = vertices[np.unique(faces[forehead_faces(vertices, faces)])].astype(float)
        assert project(own, camera, 1, 1)[0][:, 1].min() <= expected + 0.01
    assert camera.focus[1] < camera_for("forehead", vertices).focus[1]
