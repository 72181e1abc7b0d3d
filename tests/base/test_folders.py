"""A folder that can't be written is told before any work; a temporary one is short enough for sockets."""

import socket
import tempfile
from pathlib import Path

import pytest

from replicate.base.exceptions import InputError
from replicate.base.files import check_creatable, check_writable, short_temporary_folder


def test_a_folder_is_made_and_left_empty(tmp_path):
    check_writable(tmp_path / "a" / "b", "REPLICATE_RESULTS")
    assert list((tmp_path / "a" / "b").iterdir()) == []


@pytest.mark.parametrize("below", ["", "folder"])
def test_a_file_in_its_place_or_above_it_is_named_with_the_variable(tmp_path, below):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"file is a file\): set REPLICATE_RESULTS to a folder that can"):
        check_writable(tmp_path / "file" / below, "REPLICATE_RESULTS")


def test_a_folder_that_takes_no_files_is_named_with_the_variable():
    with pytest.raises(InputError, match=r"^/proc can't be written to .*REPLICATE_CACHE"):
        check_writable(Path("/proc"), "REPLICATE_CACHE")


@pytest.mark.parametrize("length", [20, 115, 200])
def test_a_socket_can_stand_in_the_temporary_folder_however_long_tmpdir_is(tmp_path, monkeypatch, length):
    long = tmp_path / ("t" * length)
    long.mkdir()
    monkeypatch.setenv("TMPDIR", str(long))
    with short_temporary_folder() as folder, socket.socket(socket.AF_UNIX) as bound:
        bound.bind(str(folder / "kernel-12345"))
    assert not folder.exists()


def test_a_short_tmpdir_is_used(monkeypatch):
    with tempfile.TemporaryDirectory(prefix="short-") as short:
        monkeypatch.setenv("TMPDIR", short)
        with short_temporary_folder() as folder:
            assert str(folder.parent) == short


def test_a_folder_that_is_not_there_yet_is_checked_and_not_made(tmp_path):
    check_creatable(tmp_path / "a" / "b", "REPLICATE_RESULTS")
    assert not list(tmp_path.iterdir())
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="REPLICATE_RESULTS"):
        check_creatable(tmp_path / "file" / "b", "REPLICATE_RESULTS")
