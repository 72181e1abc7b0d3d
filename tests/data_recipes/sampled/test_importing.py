"""From a folder to a rig: units and axes, number formats, known poses, clips, points, and a folder that grows."""

import numpy as np
import pytest
from sample_folders import FACE, neutral, shard, vertices_at, write

from data_recipes.catalogue import forget_folders, load_rig, sampled_parts
from data_recipes.function_rig import FunctionRig
from data_recipes.rig import Rig, has_function
from data_recipes.sampled import sampled_rig
from data_recipes.sampled.importing import EYES_MM, import_rig, spread_out
from data_recipes.sampled.sampled_rig import UnknownPoseError


@pytest.fixture(autouse=True)
def fresh():
    """Forget folders of other tests."""
    forget_folders()


def rig_of(folder, target):
    """Import a folder, and return the rig as it is loaded again."""
    target.mkdir()
    recipe, files = sampled_parts(folder)
    sampled_rig.save_rig(import_rig(recipe, files, target), target)
    return load_rig(target)


@pytest.fixture(scope="module")
def box(tmp_path_factory):
    """The rig of the good folder."""
    folder = tmp_path_factory.mktemp("box")
    forget_folders()
    return rig_of(write(folder / "box"), folder / "rig")


def test_the_rig_keeps_the_contract_and_gives_its_known_poses(box):
    assert isinstance(box, Rig) and not has_function(box) and not isinstance(box, FunctionRig)
    shift = box.mesh.neutral[0] - neutral()[0]
    for first in (0, 20):
        arrays = shard(first)
        np.testing.assert_allclose(box(arrays["params"]) - shift, arrays["vertices"], atol=1e-3)
    np.testing.assert_array_equal(box(box.default), box.mesh.neutral)
    assert [control.region for control in box.controls] == ["mouth", "brows", "mouth"]


def test_any_other_pose_is_an_error_that_says_why(box):
    with pytest.raises(UnknownPoseError, match="known by its samples alone, and this pose is none of these 80"):
        box(np.full(3, 0.123, np.float32))


def test_frames_stand_in_their_clips_whatever_shard_they_are_in(tmp_path):
    folder = write(tmp_path / "box")
    parts = [{k: v[::-1] for k, v in shard(20 * i).items()} for i in (1, 0)]
    for i, arrays in enumerate(parts):
        arrays["clip"] = np.where(arrays["frame"] % 2, "take 10", "take 9")
        np.savez(folder / "poses" / f"{i:03d}.npz", **arrays)
    rig = rig_of(folder, tmp_path / "rig")
    assert [clip.name for clip in rig.clips] == ["take 9", "take 10"]
    expectation = np.concatenate([shard(0)["params"][:20], shard(20)["params"][:20]])
    np.testing.assert_array_equal(rig.clips[0].values, expectation[::2])
    np.testing.assert_array_equal(rig.clips[1].values, expectation[1::2])


@pytest.mark.parametrize(("unit", "mm"), [("mm", 1.0), ("cm", 10.0), ("m", 1000.0), ("in", 25.4)])
@pytest.mark.parametrize("up", ["y", "z"])
def test_units_and_axes_become_ours(tmp_path, box, unit, mm, up):
    folder = write(tmp_path / "box")
    theirs = (lambda x: x) if up == "y" else (lambda x: np.stack([x[..., 0], -x[..., 2], x[..., 1]], -1))
    lines = (folder / "mesh.obj").read_text().splitlines()
    for k, place in enumerate(theirs(neutral()) / mm):
        lines[k] = "v {} {} {}".format(*map(float, place))
    (folder / "mesh.obj").write_text("\n".join(lines))
    for first, name in ((0, "000"), (20, "001")):
        arrays = shard(first)
        arrays["vertices"] = theirs(arrays["vertices"].astype(float)) / mm
        np.savez(folder / "poses" / f"{name}.npz", **arrays)
    (folder / "face.toml").write_text(FACE.replace('"mm"', f'"{unit}"').replace('up = "y"', f'up = "{up}"'))
    rig = rig_of(folder, tmp_path / "rig")
    np.testing.assert_allclose(rig.mesh.neutral, box.mesh.neutral, atol=1e-3)
    np.testing.assert_allclose(rig(shard(20)["params"]), box(shard(20)["params"]), atol=1e-3)


@pytest.mark.parametrize("dtype", [np.float16, np.float64, ">f4"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_other_number_formats_and_pairs_of_npy_are_read(tmp_path, dtype, order):
    folder = write(tmp_path / "box", shards=0)
    for first in (0, 20):
        arrays = shard(first)
        for name in ("params", "vertices"):
            arrays[name] = np.asarray(arrays[name].astype(dtype), order=order)
        for name, array in arrays.items():
            np.save(folder / "poses" / f"part{first:02d}.{name}.npy", array)
    rig = rig_of(folder, tmp_path / "rig")
    arrays = shard(20)
    params = arrays["params"].astype(dtype).astype(np.float32)
    shift = rig.mesh.neutral[0] - neutral()[0]
    np.testing.assert_allclose(rig(params) - shift, arrays["vertices"], atol=0.07 if dtype == np.float16 else 1e-3)


def test_eyes_are_put_where_the_cameras_expect_them(tmp_path):
    folder = write(tmp_path / "box")
    (folder / "face.toml").write_text(FACE + "eyes = [0, 50, 40]\n")
    rig = rig_of(folder, tmp_path / "rig")
    np.testing.assert_allclose(
        rig.mesh.neutral - neutral(), np.tile(np.array(EYES_MM) - [0, 50, 40], (30, 1)), atol=1e-4
    )


def test_points_are_those_of_the_file_or_far_apart_and_moving(tmp_path, box):
    assert set(box.control_point_regions) == {"mouth", "brows"}
    high = box.mesh.neutral[box.control_points, 1] > box.mesh.neutral[:, 1].mean()
    assert [region == "brows" for region in box.control_point_regions] == high.tolist()
    folder = write(tmp_path / "box")
    text = "[points]\nlandmarks = [1, 2, 3]\n[points.control_points]\nchin = [4]\nbrows = [25, 26]\n"
    (folder / "face.toml").write_text(FACE + text)
    rig = rig_of(folder, tmp_path / "rig")
    assert rig.landmarks.tolist() == [1, 2, 3] and rig.control_points.tolist() == [4, 25, 26]
    assert rig.control_point_regions == ("chin", "brows", "brows")


def test_a_folder_that_grows_is_what_it_was_until_the_next_run(tmp_path):
    folder = write(tmp_path / "box")
    before = sampled_parts(folder)
    np.savez(folder / "poses" / "002.npz.part", **shard(40))
    (folder / "poses" / "002.npz.part.npz").rename(folder / "poses" / "002.npz")
    assert sampled_parts(folder) == before  # within one run
    (tmp_path / "first").mkdir(), (tmp_path / "second").mkdir()
    assert len(import_rig(*before, tmp_path / "first").known_poses) == 80
    forget_folders()
    after = sampled_parts(folder)
    assert after[0] == before[0] and after[1] == (*before[1], folder / "poses" / "002.npz")
    assert len(import_rig(*after, tmp_path / "second").known_poses) == 120


def test_a_folder_without_clips_has_none(tmp_path):
    folder = write(tmp_path / "box", shards=0)
    params = np.random.default_rng(0).uniform(-1, 1, (50, 3)).astype(np.float32)
    np.savez(folder / "poses" / "random.npz", params=params, vertices=vertices_at(params))
    rig = rig_of(folder, tmp_path / "rig")
    assert rig.clips is None and len(rig.known_poses.frame_params) == 50


def test_vertices_in_no_face_stand_still_wherever_they_are_and_are_no_points(tmp_path, box, capfd):
    folder = write(tmp_path / "box")
    text = (folder / "mesh.obj").read_text().replace("vt 0.0", "v 0 -9000 0\nv 0 -9000 1\nvt 0.0", 1)
    (folder / "mesh.obj").write_text(text)
    for first, name in ((0, "000"), (20, "001")):
        arrays = shard(first)
        stray = np.random.default_rng(first).uniform(-9999, 9999, (len(arrays["params"]), 2, 3))
        arrays["vertices"] = np.concatenate([arrays["vertices"], stray.astype(np.float32)], axis=1)
        np.savez(folder / "poses" / f"{name}.npz", **arrays)
    rig = rig_of(folder, tmp_path / "rig")
    assert capfd.readouterr().err == f"{folder}/mesh.obj: vertices in no face, which stand still: 2\n"
    posed = rig(shard(20)["params"])
    np.testing.assert_array_equal(posed[:, 30:], np.repeat(rig.mesh.neutral[None, 30:], 40, axis=0))
    np.testing.assert_allclose(posed[:, :30], box(shard(20)["params"]), atol=1e-3)
    np.testing.assert_array_equal(rig.mesh.neutral[:30], box.mesh.neutral)
    np.testing.assert_array_equal(rig.landmarks, box.landmarks)
    np.testing.assert_array_equal(rig.control_points, box.control_points)


@pytest.mark.parametrize("still", [0.0, 1e-5])
def test_points_are_vertices_that_move_where_most_stand_still(still):
    places = np.stack([np.arange(100.0), np.zeros(100), np.zeros(100)], axis=1)
    motion = np.full(100, still)
    motion[20:40] = np.arange(1, 21)
    assert sorted(spread_out(places, motion, 20)) == list(range(30, 40)), "the half of those that move farther"
    assert len(spread_out(places, np.zeros(100), 5)) == 5


def test_what_moves_little_beside_the_rest_is_no_point_to_drag():
    places = np.stack([np.arange(100.0), np.zeros(100), np.zeros(100)], axis=1)
    motion = np.repeat([0.05, 0.2, 5.0], [40, 40, 20])  # as of a bust: shoulders, scalp, face
    assert min(spread_out(places, motion, 8)) >= 80
