"""What a user hands over is read safely, and refused in one sentence."""

import os
import time

import pytest

from replicate.base import user_files
from replicate.base.exceptions import InputError
from replicate.base.user_files import as_whole_number, check_output_file, read_bytes, read_text, read_toml, whole_number


def test_a_file_is_read_up_to_its_limit_and_no_further(tmp_path):
    file = tmp_path / "a.csv"
    file.write_bytes(b"12345")
    assert read_bytes(file, 5) == b"12345"
    with pytest.raises(InputError, match=r"a\.csv: expected at most 4e-06 MB, got a longer file"):
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
    with pytest.raises(InputError, match=r"expected a regular file, got a pipe"):
        read_bytes(pipe, 99)


@pytest.mark.parametrize(("text", "value"), [("0", 0), ("007", 7), ("9" * 18, 10**18 - 1), ("0" * 6_000 + "5", 5)])
def test_digits_are_a_whole_number(text, value):
    assert as_whole_number(text) == value


@pytest.mark.parametrize("text", ["", " ", "-1", "1.0", "½", "9" * 19, "9" * 6_000, "1_0"])
def test_any_other_text_is_refused_by_name(text):
    assert as_whole_number(text) is None
    with pytest.raises(InputError, match=r"seed: expected a whole number from 0 to 99, got ") as caught:
        whole_number(text, "seed", 0, 99)
    assert len(str(caught.value)) < 300


def test_only_regular_files_are_written(tmp_path):
    check_output_file(tmp_path / "new.glb")
    for bad in ("/dev/full", tmp_path, tmp_path / "a\0b", tmp_path / ("n" * 250)):
        with pytest.raises(InputError):
            check_output_file(user_files.Path(bad))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (".".join(["a"] * 49_000) + " = 1", "line 1 has 48,999 dots: expected at most 200, with keys of a few parts"),
        ("[" + ".".join(["a"] * 49_000) + "]", "line 1 has 48,999 dots: expected at most 200"),
        (
            ("[" + ".".join(["a"] * 190) + "]\n") + "".join(f"b{k}{'.a' * 190} = 1\n" for k in range(200)),
            "expected tables at most 8 deep",
        ),
        ("x = 1\n" + "k" * 90_000 + " = 1", "the key k+… has 90,000 characters: expected at most 100"),
        ('[points.control_points]\n"' + "k" * 101 + '" = [1]', "the key k+… has 101 characters: expected at most 100"),
        ("a = " + "{a = " * 9 + "1" + "}" * 9, "expected tables at most 8 deep"),
        ("a = [" + "{a = [" * 9 + "1" + "]}" * 9 + "]", "expected tables at most 8 deep"),
        ("a = " + "{a = " * 9_000 + "1" + "}" * 9_000, "nested too deeply"),
        ("# " + "x" * 100_000, "expected at most 0.1 MB, got a longer file"),
    ],
)
def test_a_toml_file_that_would_take_minutes_is_refused_in_seconds(tmp_path, text, message):
    file = tmp_path / "a.toml"
    file.write_text(text)
    beginning = time.monotonic()
    with pytest.raises(InputError, match=rf"a\.toml: .*{message}") as caught:
        read_toml(file)
    assert len(str(caught.value)) < 500 and time.monotonic() - beginning < 20


def test_a_toml_file_may_have_long_lists_and_tables_within_tables(tmp_path):
    file = tmp_path / "a.toml"
    file.write_text(f"a = {[0.5] * 150}\n[b.c.d.e]\nf = {{g = {{h = 1}}}}\n[[i]]\nj = 2\n")
    assert read_toml(file)["b"]["c"]["d"]["e"] == {"f": {"g": {"h": 1}}}
