"""Rigify's face rig on a head of ours: its joints, its acting, and, where Blender is, the rig and its samples."""

import json
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from data_recipes.exporters.blender_python import blender_python, run_scripts
from data_recipes.head.neutral_head import build_head
from data_recipes.recipe.reading import load_recipe
from data_recipes.rigify import face_acting, head_file, rigify_face
from data_recipes.rigify.head_file import fit_joints, marked_joints
from replicate.base.exceptions import InputError
from replicate.base.paths import ROOT

LIDS = {"lid.T.L.002": np.array([0.0, -6.0, 0.0])}


@pytest.fixture(scope="module")
def head():
    return build_head(load_recipe("tiny"))


def metarig_like(head):
    """Return joints as Rigify names them: those that are marked, half as large again and elsewhere, and two others."""
    marks = marked_joints(head)
    marks |= {name.replace(".L", ".R"): place * (-1, 1, 1) for name, place in marks.items() if ".L" in name}
    others = {"lip.T.L.001:head": marks["lip.T.L:tail"], "temple.L:head": marks["temple.L:tail"] + (0, 40.0, 0)}
    return {name: 1.5 * place + (0, 1890.0, 120.0) for name, place in (marks | others).items()}


def test_joints_lie_on_their_landmarks_whatever_the_metarig_s_place_and_size(head):
    fitted = fit_joints(head, metarig_like(head))
    for name, place in marked_joints(head).items():
        np.testing.assert_allclose(fitted[name], place, atol=1e-6)


def test_joints_that_are_one_in_the_metarig_stay_one_and_others_lie_on_the_skin(head):
    fitted = fit_joints(head, metarig_like(head))
    np.testing.assert_array_equal(fitted["lip.T.L.001:head"], fitted["lip.T.L:tail"])
    assert np.linalg.norm(head.vertices - fitted["temple.L:head"], axis=1).min() < 15.0  # this head's skin is coarse
    np.testing.assert_allclose(fitted["lid.T.R:head"], fitted["lid.T.L:head"] * (-1, 1, 1))


def test_lids_close_around_the_eye_and_lips_around_the_mouth(head):
    joints = marked_joints(head)
    eye = head.eyes["left"].centre
    assert joints["lid.T.L.002:head"][1] > eye[1] > joints["lid.B.L.002:head"][1]
    assert joints["lip.T.L:head"][1] > joints["lip.T.L.001:tail"][1] > joints["lip.B.L:head"][1] - 3
    assert joints["jaw:tail"][1] < joints["chin:tail"][1] < joints["lip.B.L:head"][1]


def test_an_eyeball_is_a_ball_that_faces_outwards_and_its_chart_has_no_flipped_triangle(head):
    eye = head.eyes["right"]
    places, faces, uv = head_file.eyeball(eye)
    np.testing.assert_allclose(np.linalg.norm(places - eye.centre, axis=1), eye.radius)
    a, b, c = (places[faces[:, i]] for i in range(3))
    assert (np.einsum("fk,fk->f", np.cross(b - a, c - a), a - eye.centre) > 0).all()
    a, b, c = (uv[faces[:, i]] for i in range(3))
    turned = np.sign(np.cross(b - a, c - a))
    assert abs(turned.sum()) == len(faces) and uv.min() >= 0 and uv.max() <= 1


def test_the_mouths_bag_hangs_on_the_lips_in_front_and_on_the_teeth_behind(head):
    bag = head_file.mouth_bag(head)
    rim = np.isin(bag[:, 0], head.grids["mouth_bag"][0])
    assert (bag[rim, 2] == 1.0).all() and (bag[np.isin(bag[:, 0], head.grids["mouth_bag"][-1]), 2] == 0.0).all()
    high = head.vertices[bag[:, 0].astype(int), 1]
    assert np.corrcoef(high, bag[:, 3])[0, 1] > 0.8 and bag[:, 3].min() == 0.0 and bag[:, 3].max() == 1.0


def test_expressions_are_mirrored_and_can_be_stronger_on_one_side():
    pose = face_acting.expression_pose({"smile": 0.5, "blink": 1.0, "open": 1.0}, LIDS, sides=(1.0, 0.5))
    np.testing.assert_allclose(pose["lips.R"], 0.5 * pose["lips.L"] * (-1, 1, 1) + 0 * pose["lips.L"])
    np.testing.assert_allclose(pose["lid.T.R.002"], 0.5 * LIDS["lid.T.L.002"])
    np.testing.assert_allclose(pose["jaw_master:turn"], (18, 0, 0))


def test_the_animation_is_the_same_every_time_begins_at_rest_and_uses_every_feeling_and_fine_control():
    fine = [f"fine_{i}" for i in range(30)]
    clips = face_acting.clips(2020, fine, LIDS)
    again = face_acting.clips(2020, fine, LIDS)
    for keys, same_keys in zip(clips.values(), again.values(), strict=True):
        for (frame, pose), (same_frame, same_pose) in zip(keys, same_keys, strict=True):
            assert frame == same_frame and pose.keys() == same_pose.keys()
            assert all(np.array_equal(pose[control], same_pose[control]) for control in pose)
    used = {control for keys in clips.values() for _, pose in keys for control in pose}
    assert set(fine) <= used and {"jaw_master:turn", "eyes", "tongue_master", "lid.T.L.002", "lid.T.R.002"} <= used
    for name, keys in clips.items():
        frames = [frame for frame, _ in keys]
        assert frames == sorted(set(frames)) and frames[0] == 1 and keys[0][1] == {}, name


def test_a_character_without_a_head_of_ours_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(rigify_face, "blender_python", lambda: tmp_path)
    monkeypatch.delenv("ICT_FACEKIT", raising=False)
    with pytest.raises(InputError):
        rigify_face.write_folder(tmp_path / "out", "nobody", 10, 0, 1, None)
    assert not (tmp_path / "out").exists()


@pytest.fixture
def without_blender(monkeypatch, head):
    """Stand in for Blender: rigs are empty files, and the exporter only counts; returns whose samples are written."""
    written = []
    monkeypatch.setattr(rigify_face, "blender_python", lambda: "python")
    monkeypatch.setattr(rigify_face, "make_blend", lambda head, blend, python: blend.write_bytes(b"a rig"))
    monkeypatch.setattr(rigify_face, "run_scripts", lambda python, script, calls, quiet: written.append(calls[0][0]))
    monkeypatch.setattr(rigify_face, "build_head", lambda recipe: head)
    return written


def test_a_blend_is_used_as_it_is_for_its_own_head_and_refused_for_another(
    without_blender, tmp_path, monkeypatch, head
):
    def write(character="tiny"):
        rigify_face.write_folder(tmp_path / "out", character, 10, 0, 1, None)

    write()
    (tmp_path / "out.blend").write_bytes(b"a rig, posed")
    write()
    assert without_blender == 2 * [str(tmp_path / "out.blend")]
    assert (tmp_path / "out.blend").read_bytes() == b"a rig, posed"
    changed = replace(head, vertices=head.vertices + 0.1 * (np.arange(len(head.vertices)) == 7)[:, None])
    monkeypatch.setattr(rigify_face, "build_head", lambda recipe: changed)
    with pytest.raises(
        InputError, match=r"has the rig on the head of tiny: name another folder, or remove the \.blend"
    ):
        write("toon")
    with pytest.raises(InputError, match=r"out\.blend has the rig on tiny's head before its recipe changed"):
        write()
    assert len(without_blender) == 2
    (tmp_path / "out.blend").unlink()
    write()
    assert len(without_blender) == 3


def test_a_blend_that_does_not_say_whose_head_it_has_is_taken_as_it_is_and_a_broken_word_is_refused(
    without_blender, tmp_path, capsys
):
    (tmp_path / "out.blend").write_bytes(b"a rig of before")
    rigify_face.write_folder(tmp_path / "out", "tiny", 10, 0, 1, None)
    assert "there is no out.head.npz to say whose head this is: using it as tiny's" in capsys.readouterr().out
    (tmp_path / "out.head.npz").write_bytes(b"half")
    with pytest.raises(InputError, match=r"out\.head\.npz can't be read: remove it"):
        rigify_face.write_folder(tmp_path / "out", "tiny", 10, 0, 1, None)
    assert len(without_blender) == 1


def test_run_as_a_module_it_looks_for_whose_head_a_file_has(tmp_path):
    (tmp_path / "out.blend").write_bytes(b"a rig of before")
    command = [sys.executable, "-m", "data_recipes.rigify.rigify_face", str(tmp_path / "out"), "--character", "tiny"]
    environment = os.environ | {"REPLICATE_BLENDER_PYTHON": "true"}
    ended = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
    assert "there is no out.head.npz to say whose head this is" in ended.stdout


def test_without_blender_one_sentence_says_how_to_get_it(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("REPLICATE_BLENDER_PYTHON", str(tmp_path / "none"))
    assert rigify_face.main([str(tmp_path / "out")]) == 2
    assert "which is no program" in capsys.readouterr().err


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return the samples of the rig on the smallest head (20 s); skipped where neither bpy nor Blender is."""
    try:
        blender_python()
    except InputError as error:
        pytest.skip(str(error))
    folder = tmp_path_factory.mktemp("rigify") / "tiny"
    rigify_face.write_folder(folder, "tiny", 40, 0, 1, None, clips="exercise")
    return folder


def test_the_rig_moves_every_part_of_the_head_as_its_bones_do(folder, head):
    shards = [np.load(path) for path in sorted((folder / "poses").glob("frames*"))]
    vertices = np.concatenate([shard["vertices"] for shard in shards]) * 1000
    x, n = vertices[0], len(head.vertices)
    np.testing.assert_allclose(
        x[:n], np.stack([head.vertices[:, 0], -head.vertices[:, 2], head.vertices[:, 1]], 1), atol=0.05
    )
    far = np.linalg.norm(vertices - x, axis=2).max(axis=0)
    parts = np.array(head.part_names)[head.part]
    assert far[n:].max() < 1e-3  # eyeballs are balls that stay
    assert (
        far[:n][np.char.startswith(parts, "tooth_upper")].max()
        < far[:n][np.char.startswith(parts, "tooth_lower")].min()
    )
    assert far[:n][parts == "face"].max() > 8.0 and far[:n][parts == "tongue"].max() > 5.0


def test_teeth_move_as_rigid_bodies(folder, head):
    shard = np.load(next((folder / "poses").glob("drawn*")))
    teeth = np.flatnonzero(np.char.startswith(np.array(head.part_names)[head.part], "tooth_lower"))
    own = shard["vertices"][:, teeth] * 1000
    apart = np.linalg.norm(own[:, :, None] - own[:, None], axis=3)
    scale = apart[:, 0, -1] / apart[0, 0, -1]
    np.testing.assert_allclose(apart, apart[:1] * scale[:, None, None], atol=0.1)


def test_the_folder_says_whose_rig_and_whose_head_it_is(folder):
    text = (folder / "face.toml").read_text()
    assert "Rigify" in text and "'tiny' of this suite" in text and "GPL" in text and "[points.control_points]" in text


def test_metarigs_of_blender_have_all_joints_that_heads_mark(head, tmp_path):
    try:
        python = blender_python()
    except InputError as error:
        pytest.skip(str(error))
    run_scripts(python, rigify_face.BUILDER, [["metarig", str(tmp_path / "joints.json")]], quiet=True)
    joints = json.loads((tmp_path / "joints.json").read_text())
    assert set(marked_joints(head)) <= set(joints)
