"""Artefacts are whole and verified, or they are not used."""

import errno
import os
import platform
import shutil

import pytest

from replicate.base.exceptions import InputError, RunError
from replicate.engine import store

NAME = "toy-0123456789abcdef"


def build(out, scratch):
    (out / "folder").mkdir()
    (out / "numbers.bin").write_bytes(bytes(range(256)))
    (out / "folder" / "text.txt").write_text("text")
    return {"stage": "toy", "notes": {"a": 1}}


def flip_a_byte(file):
    """Change one bit and leave the size and all times that a program can set as they were."""
    before = file.stat()
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))


def test_an_artefact_holds_what_was_built_and_its_facts(cache):
    folder = store.make(NAME, build)
    assert folder == cache / NAME == store.load(NAME)
    assert (folder / "folder" / "text.txt").read_text() == "text"
    manifest = store.read_manifest(folder)
    assert manifest["notes"] == {"a": 1} and sorted(manifest["files"]) == ["folder/text.txt", "numbers.bin"]
    assert not store.scratch_folder(NAME).exists()


def test_an_artefact_is_made_once(cache):
    store.make(NAME, build)
    store.make(NAME, lambda out, scratch: pytest.fail("made again"))


def test_the_cache_is_where_the_environment_says(cache, monkeypatch, tmp_path):
    store.make(NAME, build)
    monkeypatch.setenv("REPLICATE_CACHE", str(tmp_path / "elsewhere"))
    assert store.load(NAME) is None
    assert store.make(NAME, build).parent == tmp_path / "elsewhere"


@pytest.mark.parametrize("name", ["numbers.bin", "folder/text.txt", "manifest.json", "manifest.sha256"])
def test_a_flipped_byte_is_named_set_aside_and_mended(cache, capsys, name):
    folder = store.make(NAME, build)
    flip_a_byte(folder / name)
    assert store.load(NAME) is None
    errors = capsys.readouterr().err
    file = "manifest.json" if name.startswith("manifest") else name.split("/")[-1]
    assert str(folder) in errors and file in errors and errors.count("\n") == 1
    assert (cache / f"damaged-{NAME}").is_dir()
    assert not store.find_damage(store.make(NAME, build))


@pytest.mark.parametrize("harm", ["truncated", "file gone", "no manifest", "empty"])
def test_a_half_written_artefact_is_never_used(cache, capsys, harm):
    folder = store.make(NAME, build)
    if harm == "truncated":
        os.truncate(folder / "numbers.bin", 100)
    elif harm == "file gone":
        (folder / "numbers.bin").unlink()
    elif harm == "no manifest":
        (folder / "manifest.json").unlink()
    else:
        shutil.rmtree(folder)
        folder.mkdir()
    assert store.load(NAME) is None
    assert str(folder) in capsys.readouterr().err


def test_damage_found_while_making_is_mended_in_the_same_call(cache, capsys):
    flip_a_byte(store.make(NAME, build) / "numbers.bin")
    assert not store.find_damage(store.make(NAME, build))
    assert "numbers.bin" in capsys.readouterr().err


def test_what_is_left_of_making_a_damaged_artefact_is_not_used_again(cache, capsys):
    flip_a_byte(store.make(NAME, build) / "numbers.bin")
    scratch = store.scratch_folder(NAME)
    scratch.mkdir(parents=True)  # as a process killed just before its end leaves it
    os.link(cache / NAME / "numbers.bin", scratch / "numbers.bin")

    def go_on(out, scratch):
        assert not any(scratch.iterdir()), "the damage would be sealed"
        return build(out, scratch)

    assert not store.find_damage(store.make(NAME, go_on))


def test_a_failed_build_leaves_its_scratch_and_nothing_else(cache):
    def fail(out, scratch):
        (out / "half.bin").write_bytes(b"half")
        (scratch / "checkpoint").write_text("7")
        raise KeyError("a reason")

    with pytest.raises(KeyError):
        store.make(NAME, fail)
    assert store.load(NAME) is None and not any((cache / "partial").iterdir())
    assert (store.scratch_folder(NAME) / "checkpoint").read_text() == "7"


def test_what_a_killed_build_left_is_not_in_the_next_one(cache):
    remnant = cache / "partial" / f"{NAME}@{platform.node()}-1"
    remnant.mkdir(parents=True)
    (remnant / "left-over").write_text("from before")
    assert not (store.make(NAME, build) / "left-over").exists()
    assert not remnant.exists(), "it takes up room"


@pytest.mark.parametrize(
    "error",
    [OSError(errno.ENOSPC, "No space left on device"), RuntimeError("I/O: No space left on device (os error 28)")],
)
def test_a_full_disk_is_one_sentence(cache, error):
    def fail(out, scratch):
        (out / "half.bin").write_bytes(b"half")
        raise error

    with pytest.raises(RunError, match="disk is full") as failure:
        store.make(NAME, fail)
    assert "\n" not in str(failure.value) and str(cache) in str(failure.value)
    assert not (cache / NAME).exists() and not any((cache / "partial").iterdir())


def test_a_cache_that_cannot_be_made_is_an_input_error(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("REPLICATE_CACHE", str(tmp_path / "file" / "cache"))
    with pytest.raises(InputError, match="REPLICATE_CACHE"):
        store.make_cache_folder()


@pytest.mark.parametrize("damaged", [False, True])
def test_an_artefact_that_another_machine_has_put_in_place_meanwhile_is_taken_unless_it_is_damaged(
    cache, monkeypatch, tmp_path, damaged
):
    with monkeypatch.context() as elsewhere:
        elsewhere.setenv("REPLICATE_CACHE", str(tmp_path / "elsewhere"))
        theirs = store.make(NAME, lambda out, scratch: build(out, scratch) | {"notes": {"a": 2}})

    def overtaken(out, scratch):
        shutil.copytree(theirs, cache / NAME)
        if damaged:
            flip_a_byte(cache / NAME / "numbers.bin")
        return build(out, scratch)

    folder = store.make(NAME, overtaken)
    assert not store.find_damage(folder)
    assert store.read_manifest(folder)["notes"] == {"a": 1 if damaged else 2}
    assert not any((cache / "partial").iterdir()) and (cache / f"damaged-{NAME}").exists() == damaged


def test_what_is_filled_on_another_machine_is_left_alone(cache):
    theirs = cache / "partial" / f"{NAME}@{platform.node()}.elsewhere-1"
    theirs.mkdir(parents=True)
    store.make(NAME, build)
    assert theirs.is_dir()


@pytest.mark.parametrize("name", ["locks", "scratch", "partial", "logs"])
def test_a_cache_that_cannot_be_worked_in_is_an_input_error_at_once(cache, name):
    cache.mkdir()
    (cache / name).write_text("a file")
    with pytest.raises(InputError, match=f"{name} is a file.*set REPLICATE_CACHE"):
        store.make_cache_folder()


def test_a_folder_in_the_place_of_a_lock_is_an_input_error_at_once(cache):
    (cache / "locks" / f"{NAME}.lock").mkdir(parents=True)
    with pytest.raises(InputError, match=rf"{NAME}\.lock: expected a lock\'s file, got a folder: remove it"):
        store.make_cache_folder()
    with pytest.raises(InputError, match=rf"{NAME}\.lock can't be locked"):
        store.make(NAME, build)


def test_a_full_disk_elsewhere_is_named_by_its_own_folder(cache, tmp_path):
    def fail(out, scratch):
        raise OSError(errno.ENOSPC, "No space left on device", str(tmp_path / "elsewhere" / "file"))

    with pytest.raises(RunError, match="disk is full") as error:
        store.make(NAME, fail)
    assert str(tmp_path / "elsewhere") in str(error.value) and str(cache) not in str(error.value)
