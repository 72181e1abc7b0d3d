"""A face that nobody here made becomes a rig: read from a folder in ICT-FaceKit's format, with a jaw and folds of ours.

Most of it is tested on a small folder in the same format; what needs the model itself is skipped without it.
"""

import json
import os
import shutil
from dataclasses import replace

import numpy as np
import pytest
from small_facekit import ANGLE, PARTS, PIVOT, write_facekit

from data_recipes.acting import arkit_names
from data_recipes.acting.expressions import EXPRESSIONS
from data_recipes.catalogue import build_rig, expression_poses, load_rig, save_rig
from data_recipes.face_rig import face_function
from data_recipes.ict import facekit_charts, facekit_files, facekit_rig, facekit_segments, jaw_fit
from data_recipes.recipe.facekit import Reach
from data_recipes.recipe.reading import load_recipe
from replicate.__main__ import main
from replicate.approximation.rigid import find_attachments, segment_errors
from replicate.approximation.sampling import augment
from replicate.artefacts import built_rig
from replicate.artefacts.plan import Plan
from replicate.config import Config
from replicate.engine.exceptions import InputError
from replicate.geometry.normals import degenerate_faces, face_normals

TAU_MM = 0.3  # the paper's threshold of Eq. 3
REAL = os.environ.get("ICT_FACEKIT", "").strip()
needs_model = pytest.mark.skipif(not REAL, reason="ICT_FACEKIT names no folder of ICT-FaceKit")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("kit")
    write_facekit(place)
    return place


@pytest.fixture
def kit(folder, monkeypatch):
    monkeypatch.setenv("ICT_FACEKIT", str(folder))
    return folder / "mask.toml"


@pytest.fixture(scope="module")
def mask(folder):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ICT_FACEKIT", str(folder))
        return build_rig(folder / "mask.toml")


@pytest.fixture(scope="module")
def ict():
    return build_rig("ict")


def pose_of(rig, **amounts):
    columns = {control.name: column for column, control in enumerate(rig.controls)}
    values = rig.default.copy()
    for name, amount in amounts.items():
        for one in (name,) if name in columns else (f"{name}_L", f"{name}_R"):
            values[columns[one]] = amount
    return values


def drawn_poses(rig, count, seed=0):
    return augment(np.concatenate([clip.values for clip in rig.clips]), count, np.random.default_rng(seed))


def chart_areas(uv, faces):
    """Twice each chart triangle's signed area."""
    a, b, c = (uv[faces[:, k]] for k in range(3))
    return (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]


def unfolded(rig):
    """The rig's function without its wrinkles."""
    constants = rig.face.constants | {"wrinkles": {"surface": rig.face.constants["wrinkles"]["surface"]}}
    return lambda params: np.asarray(face_function(replace(rig.face, constants=constants))(params))


def moved(rig, **amounts):
    return rig(pose_of(rig, **amounts)) - rig.mesh.neutral


# The reader.


def test_an_obj_keeps_its_vertices_and_cuts_many_corners_into_fans(tmp_path):
    file = tmp_path / "a.obj"
    file.write_text(
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv -1 .5 0\n"
        "vt 0 0 0\nvt 1 0 0\nvt 1 1 0\nf 1/1/1 2/2/1 3/3/1 4/1/1\nf 1/2 3/3 -1/-1\nf 1/1 2/1 3/1 4/1 5/1\n"
    )
    vertices, uv, polygons, uv_polygons = facekit_files.read_obj(file)
    assert vertices.shape == (5, 3) and uv.shape == (3, 2)
    assert polygons.tolist() == [[0, 1, 2, 3], [0, 2, 4, -1], [0, 1, 2, -1], [0, 2, 3, -1], [0, 3, 4, -1]]
    assert uv_polygons[:2].tolist() == [[0, 1, 2, 0], [1, 2, 2, -1]]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("v 0 0 0\nvt 0 0\nf 1/1 1/1 2/1\n", "line 3 is 'f 1/1 1/1 2/1'"),
        ("v 0 0 0\nvt 0 0\nf 1 1 1\n", "line 3 is 'f 1 1 1'"),
        ("v 0 0 0\nvt 0 0\n", "found no faces"),
        ("v 0 0\nvt 0 0\nf 1/1 1/1 1/1\n", "found a line 'v' without 3 numbers"),
        ("v 0 0 nan\nvt 0 0\nf 1/1 1/1 1/1\n", "where finite numbers"),
        ("", "found a line 'v' without 3 numbers, or no such line"),
        ("v 0 0 0\nvt 0 0\nf 1/1 1/1 " + "9" * 30 + "/1\n", "line 3 is 'f 1/1 1/1 9"),
        ("v 0 0 0\nvt 0 0\nf 1/1 1/1 " + "9" * 5_000 + "/1\n", "line 3 is 'f 1/1 1/1 9"),
        ("v 0 0 0\nvt 0 0\nf" + " 1/1" * 200_000 + "\n", "where a face of 3 to 64 different corners"),
    ],
)
def test_a_broken_obj_is_named_with_what_was_found(tmp_path, text, found):
    file = tmp_path / "a.obj"
    file.write_text(text)
    with pytest.raises(InputError, match=r"a\.obj") as caught:
        facekit_files.read_obj(file)
    assert found in str(caught.value)


def test_quads_are_cut_along_the_shorter_diagonal_or_through_a_corner():
    x = np.array([[0.0, 0, 0], [2, 0, 0], [2.5, 1, 0], [0.5, 1, 0]])
    quad = np.array([[0, 1, 2, 3], [0, 1, 2, -1]])
    assert facekit_segments.triangles(quad, x).tolist() == [[0, 1, 3], [1, 2, 3], [0, 1, 2]]
    through = np.array([True, False, False, False])
    assert facekit_segments.triangles(quad, x, through).tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 2]]


# The mesh.


def test_the_mask_has_the_parts_in_mm_and_every_tooth_for_itself(mask, kit):
    sizes = {name: int((mask.mesh.segment == k).sum()) for k, name in enumerate(mask.mesh.segment_names)}
    soft = {"face": 37 * 31, "head": 7 * 12, "mouth": 42, "eye_socket_left": 25, "eye_socket_right": 25}
    assert sizes == soft | {"gums_tongue": 24, "tooth_upper_01": 8, "tooth_lower_01": 8}
    assert tuple(sizes)[:6] == PARTS[:6]
    neutral = mask.mesh.neutral
    assert np.ptp(neutral[:, 0]) == pytest.approx(150.0)
    assert neutral[mask.mesh.segment == 3, 0].mean() > 0  # left is +x
    assert not degenerate_faces(neutral, mask.mesh.faces).any()
    # Eyes at the height and depth of our own heads'; the mask's sockets are 5 mm before them.
    sockets = neutral[np.isin(mask.mesh.segment, [3, 4])]
    np.testing.assert_allclose(sockets.mean(axis=0), [0, 0, 66.4], atol=0.5)


def test_charts_are_the_models_own_or_laid_out_anew_and_nothing_flips(mask, kit):
    read = load_recipe(kit)
    segments = facekit_segments.split(facekit_files.read_model(read.vertices), read.parts, read.file)
    uv, anew = facekit_charts.build_charts(facekit_files.read_model(read.vertices), segments, 6)
    assert anew == ("head",)
    np.testing.assert_array_equal(np.clip(uv, 0, 1).astype(np.float32), mask.mesh.uv)
    u, v = np.meshgrid(np.linspace(0.01, 0.99, 31), np.linspace(0.01, 0.99, 37))
    np.testing.assert_allclose(uv[: 37 * 31], np.stack([u.ravel(), v.ravel()], 1), atol=2e-6)
    for k in range(6):
        faces = mask.mesh.faces[(mask.mesh.segment[mask.mesh.faces] == k).all(1)]
        areas = chart_areas(uv, faces)
        assert (areas > 1e-7).all() or (areas < -1e-7).all(), mask.mesh.segment_names[k]


def test_holes_are_bridged_and_borders_come_in_order():
    ring = np.arange(8)
    quads = np.stack([ring, np.roll(ring, -1), np.roll(ring, -1) + 8, ring + 8], 1)
    loops = facekit_charts.border_loops(quads)
    assert sorted(sorted(loop.tolist()) for loop in loops) == [list(range(8)), list(range(8, 16))]
    assert all((np.abs(np.diff(loop)) % 6 == 1).all() for loop in loops)
    uv = facekit_charts.lay_out(quads, np.zeros_like(quads, bool), 16, "ring")
    assert len(np.unique(uv.round(6), axis=0)) == 16


# The function.


def test_the_default_pose_is_the_neutral_without_a_fold(mask):
    assert np.abs(mask(mask.default) - mask.mesh.neutral).max() < 1e-4


def test_jaw_open_turns_about_its_pivot_and_gives_the_models_shape_in_full(mask, kit):
    read = load_recipe(kit)
    kept = facekit_rig.place_model(facekit_files.read_model(read.vertices), read)
    shift = kept.vertices[0] - facekit_files.read_model(read.vertices).vertices[0]
    lower = mask.mesh.segment == mask.mesh.segment_names.index("tooth_lower_01")
    np.testing.assert_allclose(mask.face.constants["jaw"]["pivot"], 10 * PIVOT + shift, atol=0.05)
    turn = mask.face.constants["jaw_turn"][[c.name for c in mask.controls].index("jawOpen")]
    np.testing.assert_allclose(turn, [ANGLE, 0, 0], atol=1e-4)
    for name in jaw_fit.JAW_CONTROLS:
        wanted = kept.offsets[name][: len(mask.mesh.neutral)]
        found = unfolded(mask)(pose_of(mask, **{name: 1.0})[None])[0] - mask.mesh.neutral
        assert np.abs(found - wanted).max() < 0.25  # where weights and shape disagree a hundredth is bent away
        np.testing.assert_allclose(found[lower], wanted[lower], atol=2e-3)
    half = moved(mask, jawOpen=0.5)[lower]
    chord = 0.5 * moved(mask, jawOpen=1.0)[lower]
    assert np.linalg.norm(half - chord, axis=1).min() > 0.5  # along an arc, not a chord


def test_the_teeth_and_only_they_are_found_rigid_over_poses(mask):
    vertices = mask(drawn_poses(mask, 60))
    found = find_attachments(mask.mesh, vertices, TAU_MM, 10)
    rigid = {mask.mesh.segment_names[k] for k in found.segment}
    assert {"tooth_upper_01", "tooth_lower_01"} <= rigid
    assert not rigid & {"face", "mouth"}
    assert segment_errors(mask.mesh, vertices)[:, 6:].max() < 1e-3
    assert np.abs(moved(mask, jawOpen=1.0)[mask.mesh.segment == 6]).max() < 1e-4  # the skull's stay


def test_the_jacobian_is_that_of_central_differences(mask):
    pose = np.float32(0.35) + 0.3 * np.random.default_rng(3).random(len(mask.controls), dtype=np.float32)
    exact, step = mask.jacobian(pose), 2e-3
    for column in range(len(mask.controls)):
        aside = np.zeros_like(pose)
        aside[column] = step
        difference = (mask(pose + aside) - mask(pose - aside)).astype(np.float64) / (2 * step)
        scale = np.abs(exact[:, :, column]).max()
        assert np.abs(difference - exact[:, :, column]).max() < 0.02 * scale + 0.05
    assert np.abs(exact).max(axis=(0, 1)).min() > 0.5  # every control moves something


def test_nodes_in_a_row_give_what_the_function_gives(mask):
    poses = drawn_poses(mask, 3)
    assert [node.name for node in mask.nodes][:3] == ["limit", "shapes", "jaw"]
    np.testing.assert_allclose(mask.run_nodes(poses), mask(poses), atol=1e-4)


def test_raised_brows_fold_the_forehead_and_nothing_else_does(mask):
    smooth = unfolded(mask)
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
    shut = moved(mask, eyeBlink_L=1.0)
    assert np.abs(moved(mask, eyeBlink_L=1.0, eyeSquint_L=1.0) - shut).max() < 0.05


# The rig's rest.


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
    told = arkit_names.in_their_words(["look_x_right"], ["eyeLookIn_R", "eyeLookOut_R"], np.array([[0.3], [-0.4]]))
    np.testing.assert_allclose(told, [[0.3, 0], [0, 0.4]])
    joy = expression_poses(mask)["joy"]
    assert joy[columns.index("mouthSmile_L")] == pytest.approx(EXPRESSIONS["joy"]["smile_*"])


def test_a_saved_rig_is_the_rig(mask, tmp_path):
    save_rig(mask, tmp_path / "rig")
    again = load_rig(tmp_path / "rig")
    poses = drawn_poses(mask, 4)
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
        return built_rig.stage(Plan(Config(character=str(kit)))).key

    copy = tmp_path / "elsewhere"
    shutil.copytree(folder, copy)
    assert key(copy) == key(folder) == key(copy / "FaceXModel")
    changed = copy / "FaceXModel" / "jawLeft.obj"
    changed.write_text(changed.read_text() + "# touched\n")
    assert key(copy) != key(folder)


# Bad input.


def _break(name):
    def edit(data):
        if name == "missing":
            (data / "eyeBlink_L.obj").unlink()
        elif name == "version":
            lines = (data / "generic_neutral_mesh.obj").read_text().splitlines(keepends=True)
            (data / "generic_neutral_mesh.obj").write_text("v 0 0 0\n" + "".join(lines))
        elif name == "short":
            lines = (data / "jawLeft.obj").read_text().splitlines(keepends=True)
            (data / "jawLeft.obj").write_text("".join(lines[:100]))
        elif name == "json":
            (data / "vertex_indices.json").write_text("{")
        elif name == "marks":
            table = json.loads((data / "vertex_indices.json").read_text())
            table["idx_to_landmark_verts"].pop()
            (data / "vertex_indices.json").write_text(json.dumps(table))
        elif name == "unit":
            file = data / "generic_neutral_mesh.obj"
            rows = [line.split() for line in file.read_text().splitlines()]
            rows = [[row[0], *(str(100 * float(c)) for c in row[1:])] if row[0] == "v" else row for row in rows]
            file.write_text("\n".join(map(" ".join, rows)))
        elif name == "deep":
            (data / "vertex_indices.json").write_text("[" * 100_000)
        elif name == "huge":
            table = json.loads((data / "vertex_indices.json").read_text())
            table["idx_to_landmark_verts"][3] = 10**30
            (data / "vertex_indices.json").write_text(json.dumps(table))
        elif name == "loop":
            (data / "eyeBlink_L.obj").unlink()
            (data / "eyeBlink_L.obj").symlink_to("eyeBlink_L.obj")
        elif name == "jaw":
            table = json.loads((data / "vertex_indices.json").read_text())
            table["expressions"].remove("jawForward")
            (data / "vertex_indices.json").write_text(json.dumps(table))

    return edit


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("missing", ("eyeBlink_L.obj: found no such file", "vertex_indices.json lists it")),
        ("version", ("generic_neutral_mesh.obj: found 1598 vertices, where the 1597 of ICT-FaceKit",)),
        ("short", ("jawLeft.obj: found 99 vertices, where the 1597",)),
        ("json", ("vertex_indices.json: found no readable table",)),
        ("marks", ("'idx_to_landmark_verts': found 67 landmarks, where 68",)),
        ("unit", ("is 15000 mm wide", "unit is taken to be the centimetre")),
        ("deep", ("vertex_indices.json: found no readable table",)),
        ("huge", ("'idx_to_landmark_verts': found vertex 1000000000000000000000000000000, where",)),
        ("loop", ("eyeBlink_L.obj: found no such file",)),
        ("jaw", ("found no 'jawForward'",)),
    ],
)
def test_a_folder_that_is_no_such_model_gets_one_sentence(kit, folder, tmp_path, monkeypatch, fault, words):
    shutil.copytree(folder, tmp_path / "kit")
    _break(fault)(tmp_path / "kit" / "FaceXModel")
    monkeypatch.setenv("ICT_FACEKIT", str(tmp_path / "kit"))
    with pytest.raises(InputError) as caught:
        build_rig(kit)
    assert all(word in str(caught.value) for word in words), str(caught.value)


@pytest.mark.parametrize("named", ["", "/nonexistent"])
def test_without_the_folder_the_command_ends_with_2_and_says_where_to_get_it(named, monkeypatch, capsys, cache):
    monkeypatch.setenv("ICT_FACEKIT", named)
    assert main(["table2", "--profile", "quick", "--characters", "ict"]) == 2
    said = capsys.readouterr().err
    assert "ICT-FaceKit by USC ICT on GitHub" in said and "ICT_FACEKIT=" in said and said.count("\n") == 1
    assert not cache.exists() or not list(cache.iterdir())


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("rows = 5", "rows = 1", "folds.rows is 1: allowed is a whole number from 2 to 12"),
        ("rows = 5", "rose = 5", "unknown key folds.rose: allowed are forehead"),
        ("[parts]", "[bits]", "unknown key bits: allowed are name, vertices, parts"),
        ("mouth = [", "muth = [", "unknown key parts.muth: allowed are face"),
        (
            "vertices = 1597",
            "vertices = 900",
            "parts.face is [0, 1146]: allowed are two of the model's",
        ),
    ],
)
def test_a_bad_recipe_gets_one_sentence(kit, tmp_path, old, new, sentence):
    text = kit.read_text()
    assert old in text
    (tmp_path / "mask.toml").write_text(text.replace(old, new))
    with pytest.raises(InputError) as caught:
        build_rig(tmp_path / "mask.toml")
    assert "mask.toml: " in str(caught.value) and sentence in str(caught.value)


# The model itself.


@needs_model
def test_the_model_has_its_documented_counts_and_a_heads_size(ict):
    assert (len(ict.mesh.neutral), len(ict.controls), len(ict.mesh.segment_names)) == (21451, 53, 6 + 32)
    head = ict.mesh.neutral[ict.mesh.neutral[:, 1] > -40]
    assert 150 < np.ptp(head[:, 0]) < 200
    assert sum(name.startswith("tooth_upper") for name in ict.mesh.segment_names) == 16
    assert np.abs(ict(ict.default) - ict.mesh.neutral).max() < 1e-4


@needs_model
def test_the_models_charts_flip_nothing(ict):
    for k in range(6):
        faces = ict.mesh.faces[(ict.mesh.segment[ict.mesh.faces] == k).all(1)]
        areas = chart_areas(ict.mesh.uv.astype(np.float64), faces)
        assert (areas > 0).all() or (areas < 0).all(), ict.mesh.segment_names[k]


@needs_model
def test_the_models_32_teeth_and_no_more_are_found_rigid(ict):
    vertices = ict(drawn_poses(ict, 60))
    rigid = find_attachments(ict.mesh, vertices, TAU_MM, 10).segment
    assert {name for k, name in enumerate(ict.mesh.segment_names) if name.startswith("tooth")} <= {
        ict.mesh.segment_names[k] for k in rigid
    }
    assert segment_errors(ict.mesh, vertices)[:, 6:].max() < 1e-3
    assert not set(rigid) & {0, 2, 5}  # face, mouth and tongue deform


@needs_model
def test_the_models_brows_fold_its_forehead(ict):
    from replicate.drawing.scene import forehead_faces

    faces = ict.mesh.faces[forehead_faces(ict.mesh.neutral, ict.mesh.faces)]
    rest, raised = (face_normals(v, faces) for v in (ict.mesh.neutral, ict(pose_of(ict, browInnerUp=1, browOuterUp=1))))
    turn = np.degrees(np.arccos(np.clip((rest * raised).sum(-1), -1, 1)))
    assert 5 < turn.mean() < 20
