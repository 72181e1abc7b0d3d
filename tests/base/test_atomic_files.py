"""Files are there as a whole or not at all, and who can't write one is told where."""

import errno
import os
import shutil
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from replicate.base.files import copy_file, replacing, shortage, shortage_number, write_bytes, write_text


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


@pytest.fixture
def folders(tmp_path, monkeypatch):
    """The folders of the cache and of results, the second in the first."""
    cache, results = tmp_path / "cache", tmp_path / "cache" / "results"
    results.mkdir(parents=True)
    monkeypatch.setenv("REPLICATE_CACHE", str(cache))
    monkeypatch.setenv("REPLICATE_RESULTS", str(results))
    return cache, results


@pytest.mark.skipif(not getattr(shutil, "_USE_CP_SENDFILE", False), reason="where files are copied in another way")
def test_a_copy_that_finds_no_room_names_the_folder_of_the_new_file(folders, monkeypatch):
    def refuse(*arguments):
        raise OSError(errno.ENOSPC, "No space left on device")

    cache, results = folders
    (cache / "picture.png").write_bytes(b"picture")
    monkeypatch.setattr(os, "sendfile", refuse)
    with pytest.raises(OSError, match="No space left") as error:
        copy_file(cache / "picture.png", results / "picture.png")
    assert f"free at {results}): make room or set REPLICATE_RESULTS to" in shortage(error.value, cache)


def test_a_full_folder_is_named_itself_and_not_the_one_above(folders):
    error = OSError(errno.ENOSPC, "No space left on device", str(folders[1]))  # as for an unnamed file in it
    assert f"free at {folders[1]}): make room or set REPLICATE_RESULTS to" in shortage(error)


def room(monkeypatch, **free):
    """Have one folder without room, by the name of the number that is 0 there, and much of all elsewhere."""
    file_systems = {"f_files": 1000, "f_favail": 900, "f_blocks": 1000, "f_bavail": 900}

    def statvfs(folder):
        return Mock(**file_systems | {name: 0 for name, full in free.items() if Path(folder) == full})

    def disk_usage(folder):
        return Mock(free=statvfs(folder).f_bavail << 20)

    monkeypatch.setattr(os, "statvfs", statvfs)
    monkeypatch.setattr(shutil, "disk_usage", disk_usage)


def test_where_no_more_files_can_be_made_the_sentence_speaks_of_files(folders, monkeypatch):
    room(monkeypatch, f_favail=folders[1])
    sentence = shortage(OSError(errno.ENOSPC, "No space left on device", str(folders[1] / "table2.csv")))
    assert sentence == (
        f"no more files can be made at {folders[1]} (900 MB are free, but no inodes): "
        "remove some or set REPLICATE_RESULTS to a folder elsewhere"
    )


@pytest.mark.parametrize("number", ["f_favail", "f_bavail"])
def test_an_error_without_a_name_is_of_the_folder_that_is_full(folders, monkeypatch, number):
    cache, results = folders
    room(monkeypatch, **{number: results})
    sentence = shortage(OSError(errno.ENOSPC, "No space left on device"), cache)
    assert f"at {results}" in sentence and "REPLICATE_RESULTS" in sentence


def test_a_quota_is_called_a_quota(folders):
    sentence = shortage(OSError(errno.EDQUOT, "Disk quota exceeded", str(folders[0] / "file")))
    assert sentence == f"your quota is used up at {folders[0]}: make room or set REPLICATE_CACHE to a folder elsewhere"


def test_a_full_disk_is_a_sentence_where_there_is_no_room_for_temporary_files(folders, monkeypatch):
    monkeypatch.setattr("tempfile.gettempdir", Mock(side_effect=FileNotFoundError("No usable temporary directory")))
    assert shortage(OSError(errno.ENOSPC, "No space left on device", str(folders[0] / "file")))


def test_other_errors_are_no_full_disk():
    for error in (OSError(errno.EACCES, "Permission denied"), ValueError("8 bones"), KeyError("full")):
        assert shortage_number(error) is None and shortage(error) == ""
