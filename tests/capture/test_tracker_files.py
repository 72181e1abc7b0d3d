"""Recordings of Live Link Face, OpenFace 2 and MediaPipe: read as they were written, and a sentence for each fault."""

import json
import re

import numpy as np
import pytest

from data_recipes.catalogue import FACE_LANDMARKS
from replicate.base.exceptions import InputError
from replicate.capture.capture_config import CaptureConfig
from replicate.capture.landmark_file import MM, PIXELS, write_landmarks
from replicate.capture.tracker_files import Weights, read_recording
from replicate.capture.video_landmarks import chosen_points

SECTION = CaptureConfig(longest_gap=2)
NUMBERS = list(FACE_LANDMARKS.values())
SHAPES = ("EyeBlinkLeft", "JawOpen", "BrowInnerUp")


def read(tmp_path, text, name="actor.csv", section=SECTION):
    (tmp_path / name).write_text(text)
    return read_recording(tmp_path / name, section)


def live_link(
    frames=range(8), rate=60, names=SHAPES, turns=("HeadYaw", "LeftEyeRoll"), value=lambda k, j: 0.01 * k + j / 10
):
    """Lines as the program writes them, the frames counted from 0."""
    lines = [",".join(("Timecode", "BlendShapeCount", *names, *turns))]
    for k in frames:
        seconds, frame = divmod(k, rate)
        cells = [f"{value(k, j):.6f}" for j in range(len(names))]
        lines.append(",".join([f"17:38:{seconds:02d}:{frame:02d}.{k % 7}00", "61", *cells, *["0.1"] * len(turns)]))
    return "\n".join(lines) + "\n"


def openface(frames=range(1, 7), rate=30.0, confidence=lambda k: 0.98, places=None, axes="xy", face=lambda k: 0):
    """Lines as the program writes them, with blanks after commas, the frames counted from 1."""
    points = [f"{axis}_{k}" for axis in axes for k in range(68)]
    lines = [", ".join(["frame", "face_id", "timestamp", "confidence", "success", "gaze_0_x", *points, "AU01_r"])]
    for k in frames:
        place = (moving(k) if places is None else places[k]).T.ravel()
        sure = confidence(k)
        about = [k, face(k), f"{(k - 1) / rate:.3f}", sure, int(sure > 0.5), 0.1]
        lines.append(", ".join(map(str, [*about, *place, 0.0])))
    return "\n".join(lines) + "\n"


def moving(k):
    """68 places on straight lines."""
    return np.stack([300.0 + np.arange(68) + k, 200.0 + 2 * np.arange(68) - 0.5 * k], 1)


def points(k, count=478):
    """MediaPipe's points of a frame, shares of the picture."""
    return np.stack([0.3 + 0.0005 * np.arange(count) + 0.01 * k, 0.4 + 0.0004 * np.arange(count) - 0.005 * k], 1)


def mediapipe_csv(frames=range(5), count=478):
    lines = [f"{k},{i},{x},{y},-0.02" for k in frames for i, (x, y) in enumerate(points(k, count))]
    return "frame,landmark,x,y,z\n" + "\n".join(lines) + "\n"


def as_json(k, count=478):
    return [{"x": x, "y": y, "z": 0.0} for x, y in points(k, count).tolist()]


def test_live_link_gives_weights_by_name_at_the_rate_of_its_timecodes(tmp_path):
    for rate in (24, 30, 60):
        found = read(tmp_path, live_link(range(2 * rate), rate))
        assert isinstance(found, Weights) and found.names == SHAPES and found.head == ("HeadYaw", "LeftEyeRoll")
        np.testing.assert_allclose(found.values, 0.01 * np.arange(2 * rate)[:, None] + np.arange(3) / 10, atol=1e-9)
        assert found.frames_per_second == rate and found.filled == 0
        assert found.in_words() == f"{2 * rate} frames of 3 weights from Live Link Face at {rate} frames a second"


def test_two_pictures_under_one_timecode_are_two_frames(tmp_path):
    cells = [f"17:38:{k // 60:02d}:{k // 2 % 30:02d}.{500 * (k % 2) + 20:03d},61,{k / 200}" for k in range(120)]
    found = read(tmp_path, "Timecode,BlendShapeCount,JawOpen\n" + "\n".join(cells) + "\n")
    np.testing.assert_allclose(found.values[:, 0], np.arange(120) / 200)
    assert found.frames_per_second == 60


def test_frames_that_live_link_dropped_are_interpolated_and_those_at_the_ends_left_out(tmp_path):
    text = live_link([k for k in range(130) if k not in (50, 51)])
    unseen = re.sub(r"(?m)^(17:38:00:(?:00|70|20)\S*?),61,.*$", r"\1,0", text)
    found = read(tmp_path, unseen)
    np.testing.assert_allclose(found.values[:, 0], 0.01 * np.arange(1, 130), atol=1e-9)
    assert found.filled == 3 and "1 frame without a face at the ends left out, 3 of which are int" in found.in_words()
    with pytest.raises(
        InputError, match=r"actor.csv: no face is seen in frames 50 to 52; gaps of at most 2 frames are"
    ):
        read(tmp_path, live_link([k for k in range(130) if k not in (50, 51, 52)]))


def test_openface_gives_the_54_landmarks_with_y_up(tmp_path):
    found = read(tmp_path, openface())
    truth = np.stack([moving(k)[NUMBERS] for k in range(1, 7)]) * (1, -1)
    np.testing.assert_allclose(found.positions, truth)
    assert (found.unit, found.filled, found.frames_per_second) == (PIXELS, 0, 30)
    in_mm = read(tmp_path, openface(axes="XY", rate=29.97))
    np.testing.assert_allclose(in_mm.positions, truth)
    assert (in_mm.unit, in_mm.frames_per_second) == (MM, 30)


def test_frames_that_openface_is_not_sure_of_are_gaps_whatever_they_hold(tmp_path):
    wild = {k: moving(k) if k not in (1, 5) else np.full((68, 2), -9.0) for k in range(1, 10)}
    frames = [k for k in range(1, 10) if k != 4]
    found = read(tmp_path, openface(frames, confidence=lambda k: 0.2 if k in (1, 5) else 0.9, places=wild))
    np.testing.assert_allclose(found.positions, np.stack([moving(k)[NUMBERS] for k in range(2, 10)]) * (1, -1))
    assert found.filled == 2 * 54 and "1 frame without a face at the ends left out" in found.in_words()


@pytest.mark.parametrize("count", [468, 478])
def test_mediapipe_points_are_shares_of_a_picture_whose_size_is_said_or_that_is_square(tmp_path, count):
    truth = np.stack([points(k, count)[chosen_points()] for k in range(5)])
    found = read(tmp_path, mediapipe_csv(count=count))
    np.testing.assert_allclose(found.positions, truth * (1000, -1000))
    assert "picture taken for square" in found.in_words() and found.unit == PIXELS
    found = read(tmp_path, mediapipe_csv(count=count), section=CaptureConfig(picture=(1920.0, 1080.0)))
    np.testing.assert_allclose(found.positions, truth * (1920, -1080))
    assert "square" not in found.in_words() and found.frames_per_second is None


@pytest.mark.parametrize(
    "wrap",
    [
        lambda frames: frames,
        lambda frames: {"frames": frames},
        lambda frames: {"frames": [{"faceLandmarks": [frame] if frame else []} for frame in frames]},
        lambda frames: [{"landmarks": frame} for frame in frames],
        lambda frames: [[[p["x"], p["y"], 0.0] for p in frame] if frame else None for frame in frames],
    ],
)
def test_mediapipe_json_is_read_in_the_usual_shapes_and_frames_without_a_face_are_gaps(tmp_path, wrap):
    frames = [as_json(k) if k not in (2, 5) else [] for k in range(6)]
    found = read(tmp_path, json.dumps(wrap(frames)), "actor.json")
    truth = np.stack([points(k)[chosen_points()] for k in range(5)]) * (1000, -1000)
    np.testing.assert_allclose(found.positions, truth)
    assert found.filled == 54


def test_mediapipe_json_may_say_the_size_of_the_picture_and_the_times(tmp_path):
    frames = [{"landmarks": as_json(k), "timestampMs": 40 * k} for k in range(5)]
    found = read(tmp_path, json.dumps({"width": 640, "height": 480, "frames": frames}), "actor.json")
    np.testing.assert_allclose(found.positions[3], points(3)[chosen_points()] * (640, -480))
    assert found.frames_per_second == 25
    found = read(tmp_path, json.dumps({"fps": 50, "frames": frames}), "actor.json")
    assert found.frames_per_second == 50


def test_a_file_of_the_suites_own_kind_is_read_as_before(tmp_path):
    places = np.stack([moving(k)[NUMBERS] for k in range(5)])
    write_landmarks(tmp_path / "own.csv", places, tuple(FACE_LANDMARKS), PIXELS)
    found = read_recording(tmp_path / "own.csv", SECTION)
    np.testing.assert_array_equal(found.positions, places * (1, -1))
    assert found.in_words() == "5 frames of 54 landmarks"


SHORT = live_link(range(3)).rsplit(",", 3)[0] + "\n"
SHAPELESS = live_link(range(2), names=())
BAD_POINT = json.dumps([[*as_json(0)[:-1], {"x": 0.5}]])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("time,left,right\n0,1,2\n", "line 1: expected the header .* of Live Link Face, OpenFace 2 or MediaPipe, got"),
        (SHORT, "line 4: expected 7 cells, got 4"),
        (live_link().replace("0.010000", "nan", 1), r"line 3: EyeBlinkLeft: expected a number, got 'nan'"),
        (live_link().replace("0.010000", "", 1), r"line 3: EyeBlinkLeft: expected a number, got ''"),
        (live_link().replace("0.010000", "45", 1), r"line 3: EyeBlinkLeft: expected a weight from 0 to 1, got 45"),
        (live_link(names=("EyeBlinkLeft", "EarWiggle")), "line 1: expected names of ARKit's shapes.*got 'EarWiggle'"),
        (live_link(names=("JawOpen", "JawOpen")), "line 1: the column 'JawOpen' is there twice"),
        (SHAPELESS, "line 1: expected a column for each of ARKit's shapes, got none"),
        (live_link().replace("17:38:00:03.300", "noon"), "line 5: Timecode: expected 00:00:00:00.000, got 'noon'"),
        (live_link([5, 4, 3]), "line 3: expected timecodes in rising order"),
        (live_link(()), "expected a row for each frame below the header, got none"),
        (re.sub(r",61,.*", ",0", live_link()), "no face was found in any frame"),
        (openface(confidence=lambda k: 0.1), "no face was found in any frame"),
        (openface(face=lambda k: k % 2), "expected one face, got 2, face_id 0 and 1: keep one"),
        (openface().replace(", x_3,", ", x3,"), "line 1: expected a column for .* 1 are missing, x_3 among them"),
        (openface().replace("AU01_r", "x_68"), "line 1: there is no landmark x_68: expected 68, from 0"),
        (openface().replace("367.0", "nan"), "line 2: x_66: expected a number, got ' nan'"),
        (openface()[:-40] + "\n", r"line 7: expected 143 cells, got \d+"),
        (openface((3, 2, 1)), "expected frames in rising order, got frame 2 after frame 3"),
        (openface((1, 30_000)), "expected at most 20,000 frames, got frames 1 to 30000"),
        (openface().replace("0.033", "0.033x"), "line 3: timestamp: expected a number, got ' 0.033x'"),
        (mediapipe_csv(count=400), "frame 0: expected points 0 to 467 or to 477, each once, got 400 points"),
        (mediapipe_csv().replace("\n0,3,", "\n0,4,"), "frame 0: expected points 0 to 467 or to 477, each once"),
        (mediapipe_csv().replace("x,y,z", "x,y,depth"), "line 1: there is no column depth"),
        (mediapipe_csv().replace("\n0,3,0.3", "\n0,3,300.3"), "frame 0: expected shares of the picture, from 0 to 1"),
        (mediapipe_csv().replace("\n0,3,0.3", "\n0,3,nan "), "line 5: x: expected a number, got 'nan"),
        (mediapipe_csv((0, 1, 9)), "no face is seen in frames 2 to 8; gaps of at most 2"),
        ("[[], null]", "no face was found in any frame"),
        ("[", "not a readable JSON file"),
        ('{"frame": 1}', r'expected a list of frames, or {"frames": \[…\]}'),
        ("[" + json.dumps([as_json(0)[:3]]) + "]", "frame 0: expected 468 or 478 points, got 3 points"),
        (json.dumps([[as_json(0), as_json(1)]]), "frame 0: expected one face, got 2: keep one"),
        (json.dumps([{"hand": 1}]), "frame 0: expected landmarks, got the keys 'hand'"),
        (BAD_POINT, "frame 0: point 477: expected the numbers x and y"),
        (json.dumps([as_json(0)]).replace("0.3,", "NaN,", 1), "frame 0: expected shares of the picture.*got nan"),
        (json.dumps({"width": 0, "height": 4, "frames": [as_json(0)]}), "width: expected a number of at least 1"),
    ],
)  # fmt: skip
def test_each_fault_is_named_in_one_sentence(tmp_path, text, sentence):
    with pytest.raises(InputError, match=sentence) as refused:
        read(tmp_path, text)
    assert "actor.csv" in str(refused.value) and "\n" not in str(refused.value)
