"""The moving picture of the front page: what is dragged when, a frame of it, and the committed file."""

import json

import numpy as np
import pytest
from PIL import Image
from posed_face import coarse_model, posed_face

from replicate.base import paths
from replicate.drawing.scene import Camera
from replicate.methods import coarse, regional
from replicate.poser.moving_picture import CHARACTER, RATE, SCRIPT, WIDTH, drags, frame

NAMES = ("brow_left_01", "brow_right_01", "brow_left_03", "brow_right_03", "mouth_corner_left", "mouth_corner_right")
REST = np.float32([[15, 40, 80], [-15, 40, 80], [40, 42, 70], [-40, 42, 70], [22, -60, 70], [-22, -60, 70]])


def test_points_leave_their_places_on_both_sides_alike_and_come_back():
    frames = list(drags(NAMES, REST))
    assert len(frames) == round(SCRIPT[-1][0] * RATE) and 6 <= len(frames) / RATE <= 8
    np.testing.assert_array_equal(frames[0], REST)
    moves = np.stack(frames) - REST
    np.testing.assert_allclose(moves[:, 0::2, 0], -moves[:, 1::2, 0], atol=1e-5)
    np.testing.assert_allclose(moves[:, 0::2, 1:], moves[:, 1::2, 1:], atol=1e-5)
    assert np.abs(np.diff(moves, axis=0)).max() < 5, "nothing jumps"
    assert moves[:, 0, 1].max() > 15 and moves[:, 0, 1].min() < -5 and np.abs(moves[-1]).max() < 1


def test_a_frame_shows_the_rig_and_half_of_each_method_in_colours_of_its_errors():
    faces = {coarse.METHOD: posed_face(coarse_model()), regional.METHOD: posed_face()}
    rig = faces[coarse.METHOD].rig
    targets = np.float32(rig.mesh.neutral[rig.control_points]) + np.float32([3, 0, 0])
    picture = frame(faces, targets, Camera((0, 0, 0), 260))
    assert picture.shape[1] == WIDTH and picture.dtype == np.uint8
    violet = (picture[..., 2] > picture[..., 1].astype(int) + 30).any(0)  # of small errors, in the right halves
    assert not violet[: WIDTH // 3].any() and violet[WIDTH // 3 :].any()


def test_the_committed_picture_moves_and_is_small():
    file = paths.REFERENCE / f"moving_{CHARACTER}.webp"
    with Image.open(file) as picture:
        assert picture.n_frames > 30 and picture.width == WIDTH and picture.info["loop"] == 0
        shown = 0
        for k in range(picture.n_frames):  # frames that are alike are one, shown longer
            picture.seek(k)
            picture.load()
            shown += picture.info["duration"]
        assert shown == pytest.approx(1000 * SCRIPT[-1][0], abs=150)
    assert file.stat().st_size < 3_000_000
    words = json.loads(file.with_suffix(".json").read_text())
    assert "heatmap" in words["alt"] and "inverse kinematics" in words["caption"]
