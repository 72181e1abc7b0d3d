"""A user's clip file: what is read from it, and the one sentence that each fault gets."""

import numpy as np
import pytest

from data_recipes.acting.clip_file import MOST_FRAMES, read_clip
from data_recipes.controls import make_controls
from replicate.base.exceptions import InputError

CONTROLS = make_controls({"face": 4, "head": 1})  # brow_inner_up_*, brow_outer_up_*, squash


def clip_file(tmp_path, content):
    path = tmp_path / "shot.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def test_named_controls_are_read_and_the_others_rest(tmp_path):
    poses = read_clip(clip_file(tmp_path, "squash, brow_inner_up_left\n-1,0.25\n0.5,1\n\n"), CONTROLS)
    assert poses.dtype == np.float32
    assert poses.tolist() == [[0.25, 0, 0, 0, -1], [1, 0, 0, 0, 0.5]]


@pytest.mark.parametrize(
    "content,message",
    [
        (
            "squash,jaw_open\n0,0\n",
            "header: there is no control 'jaw_open' in this rig; there are brow_inner_up_left, ",
        ),
        ("squash,squash\n0,0\n", "names 'squash' 2 times, expected once"),
        ("squash\n0\nnan\n", r"line 3, squash: expected a number from -1 to 1, got 'nan'"),
        ("squash\n1.5\n", r"line 2, squash: expected a number from -1 to 1, got '1.5'"),
        ("brow_inner_up_left\n-0.1\n", r"line 2, brow_inner_up_left: expected a number from 0 to 1, got '-0.1'"),
        ("squash\nwide\n", "line 2, squash: expected a number from -1 to 1, got 'wide'"),
        ("squash,brow_inner_up_left\n0\n", "line 2: expected 2 values, got 1"),
        ("squash\n", "expected a header of controls and a row for each frame, got 1 line"),
        ("", "a row for each frame, got no lines"),
        (b"\x89PNG\r\n\x1a\n\xff\xfe\x00", "byte 0 is no UTF-8: save the file as UTF-8"),
        ('squash\n"0\n', "expected CSV text, but it can't be read"),
    ],
)
def test_each_fault_gets_a_sentence_with_file_and_place(tmp_path, content, message):
    path = clip_file(tmp_path, content)
    with pytest.raises(InputError, match=message) as error:
        read_clip(path, CONTROLS)
    assert str(error.value).startswith(str(path)) and "\n" not in str(error.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"none\.csv: there is no such file"):
        read_clip(tmp_path / "none.csv", CONTROLS)


def test_a_clip_has_so_many_frames_and_no_more(tmp_path):
    rows = "squash\n" + "0\n" * MOST_FRAMES
    assert read_clip(clip_file(tmp_path, rows), CONTROLS).shape == (MOST_FRAMES, len(CONTROLS))
    with pytest.raises(InputError, match="line 20002: expected at most 20,000 frames, got one more"):
        read_clip(clip_file(tmp_path, rows + "0\n" * 1_000_000), CONTROLS)
