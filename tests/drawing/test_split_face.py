"""Faces in halves: the line between them tilts with the head, and each half comes from its own picture."""

import numpy as np
from plane import flat_grid

from replicate.drawing.heatmap import middle_line, split_face
from replicate.drawing.scene import Camera

VIEW = Camera((0, 0, 0), 100)


def plate(tilt_deg: float = 0.0, shift: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a plate that faces the camera, neutral and turned in its plane, and its faces."""
    flat, faces = flat_grid(np.linspace(-40, 40, 21), np.linspace(-40, 40, 21))
    cosine, sine = np.cos(np.radians(tilt_deg)), np.sin(np.radians(tilt_deg))
    turned = flat @ np.float32([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]]) + np.float32([shift, 0, 0])
    return flat, turned, faces


def test_the_line_is_where_the_neutral_face_has_its_middle():
    flat, moved, faces = plate(shift=10)
    line = middle_line(flat, moved, faces, VIEW, 100, 100)
    np.testing.assert_allclose(line, 60, atol=1.5)


def test_the_line_tilts_with_the_head():
    flat, turned, faces = plate(tilt_deg=20)
    line = middle_line(flat, turned, faces, VIEW, 100, 100)
    slope = np.degrees(np.arctan(np.diff(line).mean()))
    assert abs(slope - 20) < 2 and abs(line[50] - 50) < 1.5


def test_a_picture_without_the_face_is_halved_upright():
    flat, moved, faces = plate(shift=500)
    np.testing.assert_array_equal(middle_line(flat, moved, faces, VIEW, 80, 10), np.full(10, 40.0))


def test_each_half_comes_from_its_picture_with_a_white_seam_between():
    left, right = np.full((4, 100, 3), 10, np.uint8), np.full((4, 100, 3), 200, np.uint8)
    picture = split_face(left, right, np.array([30.0, 30, 60, 60]))
    assert (picture[:2, :29] == 10).all() and (picture[:2, 31:] == 200).all()
    assert (picture[2:, :59] == 10).all() and (picture[2:, 61:] == 200).all()
    assert (picture[0, 29:31] == 255).all() and (picture[3, 59:61] == 255).all()
