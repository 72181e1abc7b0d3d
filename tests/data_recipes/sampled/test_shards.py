"""Arrays of shards as programs write them: other types of numbers and texts, and arrays that nobody asked for."""

import numpy as np
import pytest
from sample_folders import shard, vertices_at, write

from data_recipes.catalogue import forget_folders
from data_recipes.sampled.sample_folder import open_folder
from replicate.base.exceptions import InputError


def folder_with(tmp_path, change):
    """Return a good folder whose shards' arrays went through a function."""
    forget_folders()
    folder = write(tmp_path / "box")
    for k, file in enumerate(sorted((folder / "poses").iterdir())):
        arrays = shard(20 * k)
        np.savez(file, **arrays | change(arrays))
    return folder


CHANGES = {
    "big-endian": lambda a: {"params": a["params"].astype(">f4"), "vertices": a["vertices"].astype(">f8")},
    "clips in bytes": lambda a: {"clip": np.char.encode(a["clip"], "utf-8")},
    "frames in floating point": lambda a: {"frame": a["frame"].astype(np.float32)},
    "frames of few bits": lambda a: {"frame": a["frame"].astype(np.uint8)},
}


@pytest.mark.parametrize("change", CHANGES)
def test_poses_are_the_same_in_other_types(tmp_path, change):
    plain = open_folder(write(tmp_path / "plain")).poses
    found = open_folder(folder_with(tmp_path, CHANGES[change])).poses
    for name in ("params", "frames", "drawn", "source"):
        np.testing.assert_array_equal(getattr(found, name), getattr(plain, name))
    assert found.clips == plain.clips


@pytest.mark.parametrize("kind", [np.int64, np.uint8, np.int16])
def test_parameters_may_be_whole_numbers(tmp_path, kind):
    whole = lambda a: np.rint(a["params"]).astype(kind)  # noqa: E731
    folder = folder_with(tmp_path, lambda a: {"params": whole(a), "vertices": vertices_at(whole(a)).astype("f4")})
    found = open_folder(folder)
    expectation = np.rint(np.concatenate([shard(0)["params"], shard(20)["params"]]))
    np.testing.assert_array_equal(found.poses.params, expectation.astype(np.float32))


def test_arrays_that_nobody_asked_for_are_ignored_with_a_word(tmp_path, capfd):
    extra = {"normals": np.zeros(3), "made by": np.array([{"a": 1}], object)}
    folder = folder_with(tmp_path, lambda a: extra)
    assert len(open_folder(folder).poses.params) == 80
    assert capfd.readouterr().err == f"{folder}/poses: arrays that no shard needs, left alone: made by, normals\n"


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (
            lambda a: {"frame": a["frame"] + 0.5},
            r"frame\[0\]: expected a whole number from 0 to 1,000,000,000, got 0.5",
        ),
        (lambda a: {"frame": a["frame"] * np.nan}, r"frame\[0\]: expected a whole number .*, got nan"),
        (lambda a: {"clip": np.array([b"\xff"] * 40)}, r"clip: expected texts in UTF-8"),
        (lambda a: {"clip": a["clip"].astype(object)}, r"clip: .*got Python objects: make them texts, .*dtype=str"),
        (lambda a: {"params": a["params"] > 0.5}, r"params: expected numbers"),
    ],
)
def test_what_is_no_number_or_text_is_refused(tmp_path, change, sentence):
    with pytest.raises(InputError, match=sentence):
        open_folder(folder_with(tmp_path, change))
