"""Folders of samples that contradict themselves: each gets one sentence, before anything is made of it."""

import shutil
import time

import numpy as np
import pytest
from sample_folders import FACE, obj, shard, vertices_at, write
from spoilt_folders import faults

from data_recipes.sampled.importing import SampledRecipe, import_rig
from data_recipes.sampled.sample_folder import open_folder, read_folder
from replicate import __main__ as cli
from replicate.base.exceptions import InputError

LONGEST_S, LONGEST_SENTENCE = 20.0, 2_000


@pytest.fixture(autouse=True)
def fresh():
    """Forget folders of other tests."""
    open_folder.cache_clear()


def test_more_than_a_hundred_faults_get_one_sentence_each(tmp_path):
    good, spoilt, wrong = write(tmp_path / "good"), tmp_path / "spoilt", []
    assert len(open_folder(good).poses.frames) == 40
    assert len(faults()) >= 100
    for what, fault in faults().items():
        shutil.rmtree(spoilt, ignore_errors=True)
        shutil.copytree(good, spoilt)
        fault(spoilt)
        beginning = time.monotonic()
        try:
            open_folder.__wrapped__(spoilt)
            wrong.append(f"{what}: nothing")
        except InputError as error:
            sentence = str(error)
            fits = "\n" not in sentence and len(sentence) < LONGEST_SENTENCE and str(spoilt) in sentence
            if not fits or time.monotonic() - beginning > LONGEST_S:
                wrong.append(f"{what}: {sentence[:300]}")
        except Exception as error:
            wrong.append(f"{what}: {type(error).__name__} {error}")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("what", ['unit = "km"', "NaN in vertices", "half a shard", "controls: a control twice"])
def test_a_command_ends_with_2_and_one_line_and_writes_nothing(capfd, cache, tmp_path, monkeypatch, what):
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / "results"))
    folder = write(tmp_path / "box")
    faults()[what](folder)
    assert cli.main(["table2", "--profile", "quick", "--characters", str(folder)]) == 2
    errors = capfd.readouterr().err.strip().splitlines()
    assert len(errors) == 1 and str(folder) in errors[0]
    assert not (tmp_path / "results").exists() and not cache.exists()


def refused_in_import(folder, tmp_path) -> str:
    """Return the sentence of a fault that shows only when all shards are read."""
    found = read_folder(folder)
    (tmp_path / "rig").mkdir()
    with pytest.raises(InputError) as error:
        import_rig(SampledRecipe(found.face), found.files, tmp_path / "rig")
    return str(error.value)


def test_nan_in_a_shard_that_was_not_looked_at_is_refused_when_it_is_read(tmp_path):
    folder = write(tmp_path / "box")
    arrays = shard(20)
    arrays["vertices"][5, 7, 2] = np.nan
    np.savez(folder / "poses" / "001.npz", **arrays)
    sentence = refused_in_import(folder, tmp_path)
    assert "001.npz: vertices[5, 7]" in sentence


def test_two_poses_with_the_same_parameters_that_differ_are_refused(tmp_path):
    folder = write(tmp_path / "box")
    arrays = shard(20)
    arrays["params"][4] = shard(0)["params"][2]
    arrays["vertices"][4] = vertices_at(arrays["params"][4:5])[0] + 3
    np.savez(folder / "poses" / "001.npz", **arrays)
    assert "two poses have the same parameters and vertices that differ by 3 mm" in refused_in_import(folder, tmp_path)


@pytest.mark.parametrize("name", ["no such/folder", "./box"])
def test_a_folder_that_is_not_there_is_refused_by_its_path(capfd, cache, tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["table2", "--profile", "quick", "--characters", f"'{name}'"]) == 2
    assert "face.toml: there is no such file" in capfd.readouterr().err or " " in name


@pytest.mark.parametrize("name", ["../../x", "a\nb", "x\\y"])
def test_a_clip_that_no_file_could_be_named_after_is_told_what_a_name_may_hold(tmp_path, name):
    folder = write(tmp_path / "box")
    arrays = shard(20)
    np.savez(folder / "poses" / "001.npz", **arrays | {"clip": np.array([name] * len(arrays["frame"]))})
    with pytest.raises(
        InputError, match=r"001\.npz: clip\[0\] is .*: expected a name of printable characters without / or \\"
    ):
        read_folder(folder)


def test_a_clip_may_be_named_by_any_printable_characters(tmp_path):
    folder = write(tmp_path / "box")
    for k, file in enumerate(sorted((folder / "poses").iterdir())):
        arrays = shard(20 * k)
        np.savez(file, **arrays | {"clip": np.array(["<script> ß №1"] * len(arrays["frame"]), ">U20")})
    assert read_folder(folder).poses.clips == (("<script> ß №1", 40),)


def test_what_is_written_beside_the_shards_by_another_program_is_ignored(tmp_path):
    folder = write(tmp_path / "box")
    (folder / "poses" / "002.npz.part").write_bytes(b"half")
    (folder / "poses" / ".002.npz.swp").write_bytes(b"")
    assert len(open_folder(folder).shards) == 2


def test_a_mesh_without_texture_coordinates_is_no_fault_where_groups_are_segments(tmp_path):
    folder = write(tmp_path / "box")
    (folder / "mesh.obj").write_text(obj(with_uv=False))
    (folder / "face.toml").write_text(FACE)
    assert open_folder(folder).neutral.uv is None
