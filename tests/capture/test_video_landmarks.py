"""Landmarks of a video: the table of points, pixels from shares, and a MediaPipe that is there, not there, or blind."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

from data_recipes.catalogue import FACE_LANDMARKS
from replicate.base.exceptions import InputError
from replicate.capture.landmark_file import read_landmarks
from replicate.capture.video_landmarks import chosen_points, main, pixel_landmarks

FACE = np.random.default_rng(0).uniform(0.3, 0.7, (478, 2))


class Video:
    """As many pictures as it has, which nobody looks at."""

    def __init__(self, pictures):
        self.left = pictures

    def isOpened(self):
        return self.left > 0

    def get(self, number):
        return (30.0, 640.0, 480.0)[number]

    def read(self):
        self.left -= 1
        return self.left >= 0, np.zeros((2, 2, 3), np.uint8)

    def release(self):
        pass


class Landmarker:
    """Sees the same face, moved a little, in all pictures but some."""

    def __init__(self, blind=()):
        self.blind, self.times = blind, []

    def __enter__(self):
        return self

    def __exit__(self, *error):
        return False

    def detect_for_video(self, image, time_ms):
        self.times.append(time_ms)
        index = len(self.times) - 1
        seen = [SimpleNamespace(x=x + 0.01 * index, y=y) for x, y in FACE]
        return SimpleNamespace(face_landmarks=[] if index in self.blind else [seen])


@pytest.fixture
def files(tmp_path):
    """A video, a model and where the CSV shall go; the first two hold nothing that is read."""
    for name in ("actor.mp4", "face_landmarker.task"):
        (tmp_path / name).write_bytes(b"x")
    return tmp_path / "actor.mp4", tmp_path / "face_landmarker.task", tmp_path / "actor.csv"


def install(monkeypatch, landmarker, pictures=6):
    """Put stand-ins for MediaPipe and OpenCV where imports find them."""
    vision = SimpleNamespace(
        FaceLandmarkerOptions=SimpleNamespace,
        RunningMode=SimpleNamespace(VIDEO="video"),
        FaceLandmarker=SimpleNamespace(create_from_options=lambda options: landmarker),
    )
    tasks = SimpleNamespace(vision=vision, BaseOptions=SimpleNamespace)
    image = lambda image_format, data: data  # noqa: E731
    mediapipe = SimpleNamespace(tasks=tasks, Image=image, ImageFormat=SimpleNamespace(SRGB="rgb"))
    names = {"CAP_PROP_FPS": 0, "CAP_PROP_FRAME_WIDTH": 1, "CAP_PROP_FRAME_HEIGHT": 2, "COLOR_BGR2RGB": 3}
    cv2 = SimpleNamespace(VideoCapture=lambda file: Video(pictures), cvtColor=lambda picture, kind: picture, **names)
    monkeypatch.setitem(sys.modules, "mediapipe", mediapipe)
    monkeypatch.setitem(sys.modules, "cv2", cv2)


def test_every_landmark_has_a_point_of_its_own():
    points = chosen_points()
    assert len(points) == len(set(points.tolist())) == 54 and points.min() >= 0 and points.max() < 478
    named = dict(zip(FACE_LANDMARKS, points.tolist(), strict=True))
    known = {
        "chin": 152,
        "eye_right_outer": 33,
        "eye_left_outer": 263,
        "mouth_corner_right": 61,
        "mouth_corner_left": 291,
    }
    assert {name: named[name] for name in known} == known


def test_places_are_in_pixels_and_a_frame_without_a_face_is_empty():
    places = pixel_landmarks([None, FACE], 640, 480)
    assert np.isnan(places[0]).all()
    np.testing.assert_allclose(places[1], FACE[chosen_points()] * (640, 480))
    with pytest.raises(InputError, match="no face was found"):
        pixel_landmarks([None, None], 640, 480)


def test_a_video_becomes_a_recording_that_capture_reads(files, monkeypatch, capsys):
    landmarker = Landmarker(blind=(0, 3))
    install(monkeypatch, landmarker)
    assert main(list(map(str, files))) == 0
    printed = capsys.readouterr().out
    assert "5 frames, 1 of them without a face" in printed and "frames_per_second = 30" in printed
    recording = read_landmarks(files[2], tuple(FACE_LANDMARKS), 1)
    assert recording.unit == "px" and recording.positions.shape == (5, 54, 2) and recording.filled == 54
    np.testing.assert_allclose(np.diff(recording.positions[..., 0], axis=0), 6.4)
    np.testing.assert_allclose(recording.positions[0, :, 1], -480 * FACE[chosen_points()][:, 1])
    assert landmarker.times == [0, 33, 67, 100, 133, 167]


@pytest.mark.parametrize("absent", ["mediapipe", "cv2"])
def test_without_mediapipe_one_sentence_says_what_to_install(files, monkeypatch, capsys, absent):
    install(monkeypatch, Landmarker())
    monkeypatch.setitem(sys.modules, absent, None)
    assert main(list(map(str, files))) == 2
    sentence = capsys.readouterr().err
    assert absent in sentence and "pip install mediapipe" in sentence and sentence.count("\n") == 1
    assert not files[2].exists()


def test_a_missing_video_or_an_unreadable_one_is_named(files, monkeypatch, capsys):
    assert main(["none.mp4", *map(str, files[1:])]) == 2
    assert "none.mp4: there is no such file" in capsys.readouterr().err
    install(monkeypatch, Landmarker(), pictures=0)
    assert main(list(map(str, files))) == 2
    assert "actor.mp4: OpenCV can't read this video" in capsys.readouterr().err
