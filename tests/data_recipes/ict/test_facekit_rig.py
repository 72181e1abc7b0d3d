"""A small model in ICT-FaceKit's format becomes a rig, with a jaw and folds of ours."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from rig_poses import exaggerated_poses, pose_of
from small_facekit import ANGLE, PIVOT

from data_recipes.acting import arkit_names
from data_recipes.acting.expressions import EXPRESSIONS
from data_recipes.catalogue import expression_poses, load_rig, save_rig
from data_recipes.face_rig import face_function
from data_recipes.ict import facekit_files, facekit_rig, jaw_fit
from data_recipes.recipe.facekit import Reach
from data_recipes.recipe.reading import load_recipe
from replicate.approximation.rigid import find_attachments, segment_errors
from replicate.config import Config
from replicate.methods import artefacts
from replicate.methods.plan import Plan

TAU_MM = 0.3  # the paper's threshold of Eq. 3


def without_folds(rig):
    """The rig's function without its wrinkles."""
    chain = rig.face.chain
    smooth = replace(chain, nodes=tuple(node for node in chain.nodes if node.name != "wrinkles"))
    return lambda params: np.asarray(face_function(replace(rig.face, chain=smooth))(params))


def moved(rig, **amounts):
    return rig(pose_of(rig, **amounts)) - rig.mesh.neutral


def test_the_default_pose_is_the_neutral_without_a_fold(mask):
    assert np.abs(mask(mask.default) - mask.mesh.neutral).max() < 1e-4


def test_jaw_open_turns_about_its_pivot_and_gives_the_models_shape_in_full(mask, kit):
    recipe = load_recipe(kit)
    model = facekit_rig.place_model(facekit_files.read_model(recipe.vertices), recipe)
    shift = model.vertices[0] - facekit_files.read_model(recipe.vertices).vertices[0]
    lower = mask.mesh.segment == mask.mesh.segment_names.index("tooth_lower_01")
    np.testing.assert_allclose(mask.face.constants["jaw"]["pivot"], 10 * PIVOT + shift, atol=0.05)
    turn = mask.face.constants["jaw_turn"][[c.name for c in mask.controls].index("jawOpen")]
    np.testing.assert_allclose(turn, [ANGLE, 0, 0], atol=1e-4)
    for name in jaw_fit.JAW_CONTROLS:
        expected = model.offsets[name][: len(mask.mesh.neutral)]
        offsets = without_folds(mask)(pose_of(mask, **{name: 1.0})[None])[0] - mask.mesh.neutral
        assert np.abs(offsets - expected).max() < 0.25  # where weights and shape disagree a hundredth is bent away
        np.testing.assert_allclose(offsets[lower], expected[lower], atol=2e-3)
    half = moved(mask, jawOpen=0.5)[lower]
    chord = 0.5 * moved(mask, jawOpen=1.0)[lower]
    assert np.linalg.norm(half - chord, axis=1).min() > 0.5  # along an arc, not a chord


def test_the_teeth_and_only_they_are_found_rigid_over_poses(mask):
    vertices = mask(exaggerated_poses(mask, 60))
    attachments = find_attachments(mask.mesh, vertices, TAU_MM, 10)
    rigid = {mask.mesh.segment_names[k] for k in attachments.segment}
    assert {"tooth_upper_01", "tooth_lower_01"} <= rigid
    assert not rigid & {"face", "mouth"}
    assert segment_errors(mask.mesh, vertices)[:, 6:].max() < 1e-3
    assert np.abs(moved(mask, jawOpen=1.0)[mask.mesh.segment == 6]).max() < 1e-4  # the skull's stay


def test_the_jacobian_is_that_of_central_differences(mask):
    pose = np.float32(0.35) + 0.3 * np.random.default_rng(3).random(len(mask.controls), dtype=np.float32)
    exact, step = mask.jacobian(pose), 4e-4  # a fold's height begins as a root: what is near its onset bends most
    for column in range(len(mask.controls)):
        aside = np.zeros_like(pose)
        aside[column] = step
        difference = (mask(pose + aside) - mask(pose - aside)).astype(np.float64) / (2 * step)
        scale = np.abs(exact[:, :, column]).max()
        assert np.abs(difference - exact[:, :, column]).max() < 0.02 * scale + 0.05
    assert np.abs(exact).max(axis=(0, 1)).min() > 0.5  # every control moves something


def test_nodes_in_a_row_give_what_the_function_gives(mask):
    poses = exaggerated_poses(mask, 3)
    assert [node.name for node in mask.nodes][:3] == ["limit", "shapes", "jaw"]
    np.testing.assert_allclose(mask.run_nodes(poses), mask(poses), atol=1e-4)


def test_raised_brows_fold_the_forehead_and_nothing_else_does(mask):
    smooth = without_folds(mask)
    for amounts, least, most in (({"browInnerUp": 1.0, "browOuterUp": 1.0}, 0.4, 3.0), ({"jawOpen": 1.0}, 0.0, 0.05)):
        pose = pose_of(mask, **amounts)
        folds = mask(pose) - smooth(pose[None])[0]
        forehead = mask.mesh.neutral[:, 1] > 25
        assert least <= np.abs(folds[forehead]).max() <= most


def test_exaggerated_poses_stay_within_reach(mask):
    columns = [control.name for control in mask.controls]
    u = np.asarray(facekit_rig.control_limits({n: i for i, n in enumerate(columns)}, Reach())["above"])
    assert u[columns.index("eyeBlink_L")] == pytest.approx(1.04)
    assert u[columns.index("mouthSmile_L")] == pytest.approx(1.25)
    ordinary = np.linalg.norm(moved(mask, mouthSmile_L=1.0), axis=1).max()
    extreme = np.linalg.norm(moved(mask, mouthSmile_L=3.0), axis=1).max()
    assert 1.15 * ordinary < extreme < 1.35 * ordinary
    everything = np.full(len(columns), 3.0, np.float32)
    assert np.linalg.norm(mask(everything) - mask.mesh.neutral, axis=1).max() < 100


def test_lips_close_over_an_open_jaw_only_and_a_shut_eye_squints_no_more(mask):
    assert np.abs(moved(mask, mouthClose=1.0)).max() < 1e-4
    both, alone = moved(mask, mouthClose=1.0, jawOpen=1.0), moved(mask, jawOpen=1.0)
    assert np.abs(both - alone).max() > 5
    blink = moved(mask, eyeBlink_L=1.0)
    assert np.abs(moved(mask, eyeBlink_L=1.0, eyeSquint_L=1.0) - blink).max() < 0.05


def test_our_acting_plays_in_the_models_names(mask):
    columns = [control.name for control in mask.controls]
    poses = np.concatenate([clip.values for clip in mask.clips])
    assert len(mask.clips) == 6 and poses.min() >= 0 and poses.max() <= 1
    busy = dict(zip(columns, poses.max(axis=0), strict=True))
    assert min(busy[name] for name in ("jawOpen", "eyeBlink_L", "mouthSmile_R", "browInnerUp_L")) > 0.2
    assert (
        arkit_names.our_pose({n: i for i, n in enumerate(columns)}, {"smile_left": 0.5})[columns.index("mouthSmile_L")]
        == 0.5
    )
    values = arkit_names.in_their_words(["look_x_right"], ["eyeLookIn_R", "eyeLookOut_R"], np.array([[0.3], [-0.4]]))
    np.testing.assert_allclose(values, [[0.3, 0], [0, 0.4]])
    joy = expression_poses(mask)["joy"]
    assert joy[columns.index("mouthSmile_L")] == pytest.approx(EXPRESSIONS["joy"]["smile_*"])


def test_a_saved_rig_is_the_rig(mask, tmp_path):
    save_rig(mask, tmp_path / "rig")
    again = load_rig(tmp_path / "rig")
    poses = exaggerated_poses(mask, 4)
    np.testing.assert_array_equal(again(poses), mask(poses))
    assert again.controls == mask.controls and again.landmark_names == mask.landmark_names
    assert 20 <= len(again.landmarks) <= 30
    look = pose_of(mask, eyeLookUp_L=1.0)
    for (name, a, _, _), (_, b, _, _) in zip(mask.pose_props(look), again.pose_props(look), strict=True):
        np.testing.assert_array_equal(a, b)
        rest = {prop[0]: prop[1] for prop in mask.pose_props(mask.default)}[name]
        rises = (a - rest)[:, 1][rest[:, 2] > 75]
        assert (len(rises) == 0 or rises.mean() > 3) if name.endswith("left") else np.abs(a - rest).max() < 1e-3


def test_the_rigs_key_follows_the_folders_contents_not_its_place(kit, folder, tmp_path, monkeypatch):
    def key(place):
        monkeypatch.setenv("ICT_FACEKIT", str(place))
        return artefacts.rig_stage(Plan(Config(character=str(kit)))).key

    copy = tmp_path / "elsewhere"
    shutil.copytree(folder, copy)
    assert key(copy) == key(folder) == key(copy / "FaceXModel")
    file = copy / "FaceXModel" / "jawLeft.obj"
    file.write_text(file.read_text() + "# touched\n")
    assert key(copy) != key(folder)
