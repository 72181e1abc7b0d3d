"""Recordings of landmarks: what is written is read again, short gaps are filled, and each fault gets its sentence."""

import re

import numpy as np
import pytest

from replicate.base.exceptions import InputError
from replicate.capture.landmark_file import MM, PIXELS, read_landmarks, write_landmarks

NAMES = ("chin", "brow", "nose")
HEADER = "frame,landmark,x_mm,y_mm\n"


def moving(frames=6):
    """Places (t, 3, 2) that move on straight lines, so that interpolation finds them again."""
    start, step = np.array([[0.0, -9.0], [1.5, 8.0], [0.25, 0.0]]), np.array([[0.5, 1.0], [0.0, 0.25], [-1.0, 0.0]])
    return start + np.arange(frames)[:, None, None] * step


def lines(frames=range(4), names=NAMES, cells="1.0,2.0"):
    return [f"{frame},{name},{cells}" for frame in frames for name in names]


def read(tmp_path, text, longest_gap=2):
    file = tmp_path / "actor.csv"
    file.write_text(text)
    return read_landmarks(file, NAMES, longest_gap)


def test_a_recording_is_read_as_it_was_written(tmp_path):
    write_landmarks(tmp_path / "a.csv", moving(), NAMES, MM)
    recording = read_landmarks(tmp_path / "a.csv", NAMES, 0)
    np.testing.assert_array_equal(recording.positions, moving())
    assert (recording.unit, recording.filled) == (MM, 0) and recording.in_words() == "6 frames of 3 landmarks"


def test_pixels_point_down_and_landmarks_may_come_in_any_order(tmp_path):
    write_landmarks(tmp_path / "a.csv", moving()[:, ::-1], NAMES[::-1], PIXELS)
    recording = read_landmarks(tmp_path / "a.csv", NAMES, 0)
    np.testing.assert_array_equal(recording.positions, moving() * (1, -1))
    assert recording.unit == PIXELS


def test_short_gaps_are_interpolated_and_counted(tmp_path):
    places = moving()
    places[2:4, 1] = np.nan
    write_landmarks(tmp_path / "a.csv", places, NAMES, MM)
    recording = read_landmarks(tmp_path / "a.csv", NAMES, 2)
    np.testing.assert_allclose(recording.positions, moving(), atol=1e-12)
    assert recording.filled == 2 and "2 places of which are interpolated" in recording.in_words()


def test_frames_that_are_missing_altogether_are_a_gap(tmp_path):
    write_landmarks(tmp_path / "whole.csv", moving(), NAMES, MM)
    text = (tmp_path / "whole.csv").read_text()
    rows = [line for line in text.splitlines(keepends=True) if not line.startswith(("2,", "3,"))]
    recording = read(tmp_path, "".join(rows))
    np.testing.assert_allclose(recording.positions, moving(), atol=1e-12)
    assert recording.filled == 6
    with pytest.raises(InputError, match=r"actor.csv: no landmark is seen in frames 2 to 3; gaps of at most 1 frames"):
        read(tmp_path, "".join(rows), longest_gap=1)


def test_an_empty_place_counts_as_not_seen_and_so_does_nan(tmp_path):
    text = HEADER + "\n".join(lines()).replace("1,brow,1.0,2.0", "1,brow,,").replace("2,nose,1.0,2.0", "2,nose,nan,nan")
    recording = read(tmp_path, text + "\n")
    assert recording.filled == 2 and (recording.positions == (1.0, 2.0)).all()


@pytest.mark.parametrize(
    ("body", "sentence"),
    [
        ("", "expected 3 landmarks a frame, got none"),
        ("\n".join(lines(cells=",")), "no landmark is seen in frames 0 to 3, at the recording's end or beginning"),
        ("\n".join(lines()).replace("3,nose,1.0,2.0", "3,nose,nan,nan"), "'nose' is not seen in frame 3, at the rec"),
        ("\n".join(lines()).replace("0,nose,1.0,2.0", "0,nose,,"), "'nose' is not seen in frame 0, at the recording"),
        ("\n".join(lines(range(9))).replace("\n4,chin,1.0,2.0", "\n4,chin,,").replace("\n5,chin,1.0,2.0", "\n5,chin,,")
         .replace("\n6,chin,1.0,2.0", "\n6,chin,,"), "'chin' is not seen in frames 4 to 6; gaps of at most 2"),
        ("\n".join(lines()[:-1]), "frame 3 has 2 of 3 landmarks, and 'nose' is missing"),
        ("\n".join(lines(names=("chin", "brow", "ear"))), "line 4: there is no landmark 'ear'; there are chin, brow"),
        ("\n".join(lines((0, 2, 1))), "line 8: expected frames in rising order, got frame 1 after frame 2"),
        ("\n".join(lines((0, 1, 1))), "line 8: 'chin' of frame 1 comes a second time"),
        ("\n".join(lines()).replace("2,brow,1.0", "2,brow,inf"), "line 9: x_mm: expected a number from .*, got inf"),
        ("\n".join(lines()).replace("2,brow,1.0,2.0", "2,brow,1.0,-1e300"),
         r"line 9: y_mm: expected a number from -1,000,000 to 1,000,000, got -1e\+300"),
        ("\n".join(lines()).replace("2,brow,1.0,2.0", "2,brow,,3.0"), "line 9: y_mm is there and x_mm is not; give"),
        ("\n".join(lines()).replace("2,brow,1.0,2.0", "2,brow,3.0,nan"), "line 9: x_mm is there and y_mm is not"),
        ("\n".join(lines()).replace("3,brow", f"{10**18},brow"), "line 12: frame: expected .* at most 18 digits"),
        ("\n".join(lines()).replace("2,brow", '2,"brow'), r"line 9: expected comma-separated values \(unexp"),
        ("\n".join(lines()).replace("2,brow,1.0", "2,brow,left"), "line 9: x_mm: expected a number, got 'left'"),
        ("\n".join(lines()).replace("2,brow", "2.5,brow"), "line 9: frame: expected a whole number, got '2.5'"),
        ("\n".join(lines()).replace("2,brow,1.0,2.0", "2,brow,1.0"), "line 9: expected 4 cells, got 3"),
        ("\n".join(lines((0, 30_000))), "expected at most 20,000 frames, got frames 0 to 30000"),
    ],
)  # fmt: skip
def test_each_fault_is_named(tmp_path, body, sentence):
    with pytest.raises(InputError, match=sentence) as refused:
        read(tmp_path, HEADER + body + "\n" * bool(body))
    assert "actor.csv" in str(refused.value) and "\n" not in str(refused.value)


@pytest.mark.parametrize("header", ["landmark,frame,x_mm,y_mm", "frame,landmark,y_mm,x_mm", "", "frame;landmark;x;y"])
def test_other_columns_or_another_order_are_refused_with_both_headers(tmp_path, header):
    both = "'frame,landmark,x_mm,y_mm' or 'frame,landmark,x_px,y_px'"
    with pytest.raises(InputError, match=re.escape(both)):
        read(tmp_path, header + "\n" + "\n".join(lines()))


def test_what_is_no_text_or_no_file_is_refused(tmp_path):
    (tmp_path / "picture.csv").write_bytes(b"\x89PNG\r\n\xff\xfe")
    for name, part in (("picture.csv", "no UTF-8"), ("none.csv", "no such file"), (".", "a folder")):
        with pytest.raises(InputError, match=part):
            read_landmarks(tmp_path / name, NAMES, 0)
