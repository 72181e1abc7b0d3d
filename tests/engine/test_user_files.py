"""What a user hands over is read safely, and refused in one sentence."""

import os

import pytest

from replicate.engine import user_files
from replicate.engine.exceptions import InputError
from replicate.engine.user_files import (
    as_whole_number,
    check_output_file,
    read_bytes,
    read_text,
    read_toml,
    whole_number,
)


def test_a_file_is_read_up_to_its_limit_and_no_further(tmp_path):
    file = tmp_path / "a.csv"
    file.write_bytes(b"12345")
    assert read_bytes(file, 5) == b"12345"
    with pytest.raises(InputError, match=r"a\.csv: the file is too long: allowed are 4e-06 MB"):
        read_bytes(file, 4)


def test_a_byte_order_mark_is_no_part_of_a_text(tmp_path):
    file = tmp_path / "a.toml"
    file.write_bytes(b"\xef\xbb\xbfa = 1\n")
    assert read_text(file, 99) == "a = 1\n" and read_toml(file) == {"a": 1}


def test_nothing_is_read_of_a_pipe_that_takes_a_files_place(tmp_path, monkeypatch):
    pipe = tmp_path / "a.toml"
    os.mkfifo(pipe)
    (tmp_path / "regular").write_text("")
    regular = os.stat(tmp_path / "regular")
    monkeypatch.setattr(user_files.os, "stat", lambda _: regular)
    with pytest.raises(InputError, match=r"is a pipe: allowed is a regular file"):
        read_bytes(pipe, 99)


@pytest.mark.parametrize(("text", "value"), [("0", 0), ("007", 7), ("9" * 18, 10**18 - 1), ("0" * 6_000 + "5", 5)])
def test_digits_are_a_whole_number(text, value):
    assert as_whole_number(text) == value


@pytest.mark.parametrize("text", ["", " ", "-1", "1.0", "½", "9" * 19, "9" * 6_000, "1_0"])
def test_any_other_text_is_refused_by_name(text):
    assert as_whole_number(text) is None
    with pytest.raises(InputError, match=r"seed is .*: allowed is a whole number from 0 to 99") as caught:
        whole_number(text, "seed", 0, 99)
    assert len(str(caught.value)) < 300


def test_only_regular_files_are_written(tmp_path):
    check_output_file(tmp_path / "new.glb")
    for bad in ("/dev/full", tmp_path, tmp_path / "a\0b", tmp_path / ("n" * 250)):
        with pytest.raises(InputError):
            check_output_file(user_files.Path(bad))
