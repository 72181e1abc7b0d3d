"""Rigs on disk come back as they were, and work whatever they are asked first."""

import json
import time

import numpy as np
import pytest
from box import foreign
from rig_poses import augmented_poses

from data_recipes.catalogue import load_rig, save_rig
from replicate.base.exceptions import InputError


def test_a_saved_rig_comes_back_the_same_and_without_its_geometry(tiny, tmp_path, monkeypatch):
    save_rig(tiny, tmp_path / "tiny")
    for builder in ("recipe_rig.build_head", "recipe_rig.build_step"):
        monkeypatch.setattr(f"data_recipes.{builder}", lambda *_: pytest.fail("built again"))
    start = time.process_time()
    again = load_rig(tmp_path / "tiny")
    assert time.process_time() - start < 3
    p = augmented_poses(tiny, 3)
    np.testing.assert_array_equal(again(p), tiny(p))
    assert again.controls == tiny.controls
    for name in ("control_point_names", "control_point_regions", "face_mark_regions"):
        assert getattr(again, name) == getattr(tiny, name)
    for name in ("control_points", "face_marks", "landmarks"):
        np.testing.assert_array_equal(getattr(again, name), getattr(tiny, name))
    assert [c.name for c in again.clips] == [c.name for c in tiny.clips]
    for one, other in zip(again.pose_props(p[0]), tiny.pose_props(p[0]), strict=True):
        np.testing.assert_array_equal(one[1], other[1])
        np.testing.assert_array_equal(one[3], other[3])
    np.testing.assert_array_equal(again.paint, tiny.paint)
    assert not list((tmp_path / "tiny").glob("*.part"))


FIRST = {
    "a pose": lambda rig, p: rig(p),
    "the Jacobian": lambda rig, p: rig.jacobian(p, [0]),
    "the nodes": lambda rig, p: rig.run_nodes(p[None]),
    "the folds": lambda rig, p: rig.wrinkle_states(p),
    "the props": lambda rig, p: rig.pose_props(p),
}


@pytest.mark.parametrize("first", FIRST)
def test_a_loaded_rig_may_be_asked_for_anything_first(tiny, tmp_path, first):
    save_rig(tiny, tmp_path)
    again, p = load_rig(tmp_path), augmented_poses(tiny, 1)[0].astype(np.float32)
    FIRST[first](again, p)
    np.testing.assert_array_equal(again(p), tiny(p))
    np.testing.assert_array_equal(again.jacobian(p, [1]), tiny.jacobian(p, [1]))
    np.testing.assert_array_equal(again.run_nodes(p[None]), tiny.run_nodes(p[None]))


def test_a_rig_of_a_chain_that_there_is_not_is_refused(tiny, tmp_path):
    save_rig(tiny, tmp_path)
    about = json.loads((tmp_path / "rig.json").read_text())
    (tmp_path / "rig.json").write_text(json.dumps(about | {"chain": "puppet"}))
    with pytest.raises(InputError, match=r"there is no chain 'puppet'; there are face.*, ict"):
        load_rig(tmp_path)


def test_a_rig_of_other_peoples_code_is_not_saved(tmp_path):
    with pytest.raises(InputError, match=r"rig 'box': only rigs built from recipes can be saved"):
        save_rig(foreign(), tmp_path / "nowhere")
    assert not (tmp_path / "nowhere").exists()


@pytest.mark.parametrize("fault", ["cut", "no arrays", "other format", "no json"])
def test_a_damaged_folder_is_named(tiny, tmp_path, fault):
    folder = tmp_path / "tiny"
    save_rig(tiny, folder)
    if fault == "cut":
        (folder / "rig.npz").write_bytes((folder / "rig.npz").read_bytes()[:5000])
    elif fault == "no arrays":
        (folder / "rig.npz").unlink()
    elif fault == "other format":
        about = json.loads((folder / "rig.json").read_text())
        (folder / "rig.json").write_text(json.dumps(about | {"format": 99}))
    else:
        (folder / "rig.json").write_text("{")
    with pytest.raises(InputError, match=r"rig|tiny"):
        load_rig(folder)
