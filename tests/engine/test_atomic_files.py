"""Files are there as a whole or not at all, and who can't write one is told where."""

import errno

import numpy as np
import pytest

from replicate.engine.atomic_files import copy_file, replacing, write_bytes, write_text
from replicate.engine.full_disk import shortage, shortage_number


def test_a_file_has_its_contents_and_nothing_stands_beside_it(tmp_path):
    write_text(tmp_path / "a.csv", "ä\n\r\n")
    assert (tmp_path / "a.csv").read_bytes() == "ä\n\r\n".encode()
    write_bytes(tmp_path / "a.csv", b"new", durable=True)
    copy_file(tmp_path / "a.csv", tmp_path / "b")
    assert (tmp_path / "b").read_bytes() == b"new" and len(list(tmp_path.iterdir())) == 2


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path):
    write_text(tmp_path / "a", "old")
    with pytest.raises(KeyError), replacing(tmp_path / "a") as new:
        new.write_text("half")
        raise KeyError
    assert [file.name for file in tmp_path.iterdir()] == ["a"] and (tmp_path / "a").read_text() == "old"


def test_writers_that_look_at_the_ending_find_it(tmp_path):
    with replacing(tmp_path / "a.npz") as new:
        np.savez(new, one=np.ones(2))
    assert np.load(tmp_path / "a.npz")["one"].tolist() == [1, 1]


def test_two_writers_of_one_file_do_not_meet(tmp_path):
    with replacing(tmp_path / "a") as one, replacing(tmp_path / "a") as other:
        one.write_text("one")
        other.write_text("other")
    assert (tmp_path / "a").read_text() == "one"


def test_the_longest_name_can_be_written_and_a_longer_one_is_named(tmp_path):
    write_text(tmp_path / ("a" * 255), "long")
    with pytest.raises(OSError, match="a" * 256) as error:
        write_text(tmp_path / ("a" * 256), "too long")
    assert error.value.errno == errno.ENAMETOOLONG


@pytest.mark.parametrize(
    "error", [OSError(errno.ENOSPC, "No space left on device"), OSError("9 requested and 4 written")]
)
def test_a_full_disk_names_the_folder_of_the_file(tmp_path, error):
    with pytest.raises(OSError, match="No space left") as failure, replacing(tmp_path / "results.csv"):
        raise error
    assert failure.value.filename == str(tmp_path / "results.csv")
    sentence = shortage(failure.value)
    assert sentence.startswith("the disk is full") and f"free at {tmp_path})" in sentence


def test_errors_of_other_files_stay_as_they_are(tmp_path):
    with pytest.raises(FileNotFoundError) as error:
        copy_file(tmp_path / "nowhere", tmp_path / "a")
    assert error.value.filename == str(tmp_path / "nowhere")


@pytest.mark.parametrize("variable", ["REPLICATE_CACHE", "REPLICATE_RESULTS", "TMPDIR"])
def test_a_full_disk_says_which_variable_moves_its_folder(tmp_path, monkeypatch, variable):
    for number, name in enumerate(("REPLICATE_CACHE", "REPLICATE_RESULTS")):
        monkeypatch.setenv(name, str(tmp_path / str(number)))
    monkeypatch.setattr("tempfile.gettempdir", lambda: str(tmp_path / "2"))
    folder = tmp_path / str(["REPLICATE_CACHE", "REPLICATE_RESULTS", "TMPDIR"].index(variable))
    folder.mkdir()
    assert f"or set {variable} to a folder elsewhere" in shortage(OSError(errno.ENOSPC, "full", str(folder / "x")))


def test_other_errors_are_no_full_disk():
    for error in (OSError(errno.EACCES, "Permission denied"), ValueError("8 bones"), KeyError("full")):
        assert shortage_number(error) is None and shortage(error) == ""
