"""A rig of ours as a folder of samples, and read back: the same poses, and a character for every table."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rigs

from data_recipes.catalogue import (
    expression_poses,
    forget_folders,
    import_sampled,
    load_rig,
    sampled_parts,
    write_folder,
)
from replicate import __main__ as cli
from replicate.approximation.influence import influence, influence_poses
from replicate.approximation.samples import SampleSet, choose_poses, write_samples
from replicate.base.exceptions import InputError
from replicate.base.progress import progress
from replicate.config import SamplesConfig, resolve
from replicate.drawing.rig_views import open_mouth
from replicate.engine.provenance import provenance
from replicate.engine.scheduler import run
from replicate.engine.stage import stream_rng
from replicate.methods import artefacts
from replicate.methods.plan import Plan
from replicate.report.results import find, read_results
from replicate.rig_study.interaction import no_interaction
from replicate.targets.export_samples import drawn_shards, tried_influence
from replicate.targets.rig_report import rows as rig_report_rows

NUMBERS = SamplesConfig(count=200, validation=8)
CONFIG = """
[samples]
count = 200
validation = 8
[evaluation]
test_poses = 40
"""


def rng(stream: str) -> np.random.Generator:
    """Return the generator of a stream of the stage "samples"."""
    return stream_rng(0, "samples", stream)


def write_sample_folder(rig, folder, numbers, seed, moves=None) -> int:
    """Write a rig's samples; return the number of poses."""
    count, shards = drawn_shards(rig, numbers, seed)
    write_folder(rig, folder, count, shards, moves=moves)
    return count


@pytest.fixture(scope="module")
def tiny():
    """Tiny with a few clips, so that it takes seconds."""
    rig = rigs.rig("tiny")
    return replace(rig, clips=rig.clips[:4])


@pytest.fixture(scope="module")
def folder(tmp_path_factory, tiny):
    """Tiny as a folder of samples."""
    folder = tmp_path_factory.mktemp("written") / "tiny_again"
    write_sample_folder(tiny, folder, NUMBERS, 0, tried_influence(tiny, NUMBERS, 0))
    return folder


@pytest.fixture(scope="module")
def again(tmp_path_factory, folder):
    """The rig of that folder."""
    forget_folders()
    return import_sampled(*sampled_parts(folder), tmp_path_factory.mktemp("rig"), progress)


def test_mesh_controls_clips_and_points_are_the_same(tiny, again):
    for name in ("neutral", "segment", "segment_names"):
        np.testing.assert_array_equal(getattr(again.mesh, name), getattr(tiny.mesh, name))
    assert sorted(map(sorted, again.mesh.faces.tolist())) == sorted(map(sorted, tiny.mesh.faces.tolist()))
    soft = [k for k, name in enumerate(tiny.mesh.segment_names) if not name.startswith("tooth")]  # narrow: stretched
    own = np.isin(tiny.mesh.segment, soft)
    np.testing.assert_allclose(again.mesh.uv[own], tiny.mesh.uv[own], atol=1e-6)
    assert again.controls == tiny.controls and set(again.control_points) == set(tiny.control_points)
    assert [clip.name for clip in again.clips] == [clip.name for clip in tiny.clips]
    for one, other in zip(again.clips, tiny.clips, strict=True):
        np.testing.assert_array_equal(one.values, other.values)


def test_training_validation_and_test_poses_are_the_same(tiny, again):
    for split in ("frames", "clips"):
        numbers = replace(NUMBERS, split=split)
        theirs, ours = choose_poses(tiny, numbers, rng), choose_poses(again, numbers, rng)
        for part in ("validation", "test"):
            np.testing.assert_array_equal(ours[part], theirs[part])
        if split == NUMBERS.split:  # the poses were drawn from the training frames of this one
            np.testing.assert_array_equal(ours["training"], theirs["training"])
    other = choose_poses(again, NUMBERS, lambda stream: stream_rng(1, "samples", stream))
    held_out = {pose.tobytes() for part in ("validation", "test") for pose in other[part]}
    assert (
        not held_out & {pose.tobytes() for pose in other["training"]}
        and 0.7 * NUMBERS.count < len(other["training"]) < NUMBERS.count
    )


def test_the_folder_says_which_control_moves_which_vertex_and_loading_keeps_it(tmp_path, tiny, again, folder):
    assert again.moves.shape == (len(tiny.mesh.neutral), len(tiny.controls)) and again.moves.dtype == bool
    poses = influence_poses(tiny, choose_poses(tiny, NUMBERS, lambda s: stream_rng(0, "influence", s))["training"],
                            stream_rng(0, "influence", "poses"))  # fmt: skip
    np.testing.assert_array_equal(again.moves, influence(tiny, poses))
    shutil.copytree(folder, bare := tmp_path / "tiny_again")
    (bare / "influence.npy").unlink()
    forget_folders()
    recipe, files = sampled_parts(bare)
    assert "influence.npy" not in {file.name for file in files}
    assert import_sampled(recipe, files, tmp_path / "rig", progress).moves is None
    assert load_rig(tmp_path / "rig").moves is None


def test_networks_see_the_controls_that_the_folder_names(cache, tmp_path, folder):
    shutil.copytree(folder, own := tmp_path / "tiny_again")
    moves = np.zeros_like(np.load(own / "influence.npy"))
    moves[7, 3] = True
    np.save(own / "influence.npy", moves)
    forget_folders()
    (tmp_path / "numbers.toml").write_text(CONFIG)
    stage = artefacts.influence_stage(Plan(resolve(str(own), "quick", None, tmp_path / "numbers.toml", seed=0)))
    made = run([stage], facts=provenance(["a test"], "quick", [], 1))
    np.testing.assert_array_equal(artefacts.load_influence({"influence": made[stage.title]}), moves)


def test_vertices_are_the_same_to_rounding(tmp_path, tiny, again):
    sets = []
    for name, rig in (("theirs", tiny), ("ours", again)):
        (tmp_path / name).mkdir()
        write_samples(rig, NUMBERS, tmp_path / name, rng, tmp_path / f"{name}_scratch", progress)
        sets.append(SampleSet.open(tmp_path / name))
    theirs, ours = sets
    np.testing.assert_allclose(ours.test_offsets, theirs.test_offsets, atol=2e-5)
    rows = np.arange(len(theirs))
    np.testing.assert_allclose(ours.offsets(rows), theirs.offsets(rows), atol=float(theirs.steps_mm.max()) + 2e-5)
    np.testing.assert_array_equal(ours.bins, theirs.bins)


def test_the_folder_is_a_character_for_table2(capfd, cache, tmp_path, monkeypatch, folder):
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / "results"))
    (tmp_path / "numbers.toml").write_text(CONFIG)
    words = ["table2", "--profile", "quick", "--characters", str(folder), "--numbers-only", "--jobs", "2"]
    assert cli.main([*words, "--methods", "linear", "neutral", "--config", str(tmp_path / "numbers.toml")]) == 0
    rows = read_results(tmp_path / "results" / "quick" / "table2.csv")
    linear, neutral = (find(rows, "table2", "tiny_again", name, "vertex_error_mean") for name in ("linear", "neutral"))
    assert 0 < linear.value < neutral.value / 2 and linear.poses == 40
    before = sorted(path.name for path in cache.glob("rig-tiny_again-*"))
    shutil.copytree(folder, grown := tmp_path / "tiny_again")
    with np.load(grown / "poses" / "00001.npz") as arrays:
        count = len(arrays["params"])
        more = dict(arrays) | {"clip": np.array(["later"] * count), "frame": np.arange(count)}
    np.savez(grown / "poses" / "99999.npz", **more)
    words[4] = str(grown)
    assert cli.main([*words, "--methods", "neutral", "--config", str(tmp_path / "numbers.toml")]) == 0
    assert len(set(cache.glob("rig-tiny_again-*"))) == len(before) + 1  # another rig, by its content


@pytest.mark.parametrize("target", ["table4", "figure11", "figure12", "tour"])
def test_what_asks_the_rig_itself_says_so_in_a_sentence(capfd, cache, folder, target):
    assert cli.main([target, "--characters", str(folder)]) == 2
    errors = capfd.readouterr().err.strip().splitlines()
    assert len(errors) == 1 and f"make {target} asks the rig" in errors[0] and not cache.exists()


def test_status_knows_of_all_that_such_a_rig_has(capfd, cache, folder):
    assert cli.main(["status", "--profile", "quick", "--characters", str(folder)]) == 0
    lines = capfd.readouterr().out
    assert re.search("^table2 +tiny_again: never made; ", lines, re.MULTILINE) and "table4" not in lines


def test_expressions_are_known_frames_and_no_pair_of_controls_can_be_tried(again):
    shown = expression_poses(again)
    assert next(iter(shown)) == "neutral" and len(shown) > 5
    assert again(np.stack(list(shown.values()))).shape == (len(shown), *again.mesh.neutral.shape)
    assert rig_report_rows.strongest_pairs(again, no_interaction(918, len(again.controls))) == []
    opened = open_mouth(again)
    assert again.known_poses.find(opened) is not None and np.abs(opened - again.default).max() > 0.3


def test_a_place_with_anything_in_it_is_left_alone(tmp_path, tiny):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="is there already"):
        write_sample_folder(tiny, tmp_path, NUMBERS, 0)
    assert [file.name for file in tmp_path.iterdir()] == ["notes.txt"]


def test_a_rig_without_clips_is_written_without_them(tmp_path, tiny):
    count = write_sample_folder(replace(tiny, clips=None), tmp_path / "still", replace(NUMBERS, uniform_test=30), 0)
    assert count == 200 + 8 + 30
    with np.load(next(Path(tmp_path / "still" / "poses").iterdir())) as arrays:
        assert sorted(arrays.files) == ["params", "vertices"]
