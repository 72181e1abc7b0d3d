"""Folders of samples with one pose a shape: read as the face of shapes that a folder of meshes with them is."""

import csv
import shutil

import numpy as np
import pytest
import sample_folders
from shape_faces import ARKIT, shapes_of, split_sheet

from data_recipes.catalogue import (
    build_rig,
    character_parts,
    control_names,
    expression_poses,
    forget_folders,
    load_rig,
    save_rig,
)
from data_recipes.recipe_paths import character_label, check_function, in_command, sample_folder, shape_file
from data_recipes.rig import has_function
from replicate import __main__ as cli

NAMES = ARKIT[:6]
SAID = "no pose moves more than one control, so the face is read as the sum of their shapes"


@pytest.fixture(autouse=True)
def fresh():
    """Forget folders of other tests."""
    forget_folders()


def mesh_text(vertices, faces):
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in vertices]
    return "".join(lines) + "g Head\n" + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in faces)


def write_poses(folder, poses=None, table="", face='unit = "mm"\nup = "y"\nmesh = "mesh.obj"\n', **arrays):
    """Write a sheet's shapes as samples: poses (t, m) of controls 0 … 1, the neutral and each control's if None."""
    vertices, faces, _ = split_sheet()
    shapes = np.stack(list(shapes_of(vertices, NAMES).values()))
    poses = np.concatenate([np.zeros((1, len(NAMES))), np.eye(len(NAMES))]) if poses is None else np.array(poses)
    (folder / "poses").mkdir(parents=True)
    (folder / "mesh.obj").write_text(mesh_text(vertices, faces))
    table = table or "".join(f"{name},0,0,1,\n" for name in NAMES)
    (folder / "controls.csv").write_text("name,lower,default,upper,region\n" + table)
    (folder / "face.toml").write_text(face)
    arrays = {"params": poses, "vertices": vertices + np.tensordot(poses, shapes, 1)} | arrays
    np.savez(folder / "poses" / "a.npz", **{name: np.asarray(array) for name, array in arrays.items()})
    return folder, vertices, shapes


def apart(rig, vertices, params, truth):
    """Return how far a rig's offsets are from true ones (b, n, 3), at most."""
    place = rig.file_vertices
    assert len(place) == len(vertices)
    return np.abs((rig(np.float32(params)) - rig.mesh.neutral)[:, place] - truth).max()


def test_it_is_the_rig_that_a_folder_with_a_mesh_for_each_shape_is(tmp_path, capfd):
    folder, vertices, shapes = write_poses(tmp_path / "poses_of" / "anna")
    (meshes := tmp_path / "meshes_of" / "anna").mkdir(parents=True)
    (meshes / "face.toml").write_text('unit = "mm"\n')
    for name, shape in zip(("neutral", *NAMES), [0 * vertices, *shapes], strict=True):
        (meshes / f"{name}.obj").write_text(mesh_text(vertices + shape, split_sheet()[1]))
    assert sample_folder(str(folder)) is None and shape_file(str(folder)) == folder
    rig, other = build_rig(folder), build_rig(meshes)
    assert f"{folder}/poses: {SAID}" in capfd.readouterr().err
    order = [[control.name for control in other.controls].index(name) for name in NAMES]  # those are sorted by name
    assert rig.controls == tuple(other.controls[k] for k in order)
    poses = np.random.default_rng(0).uniform(0, 1, (20, len(NAMES))).astype(np.float32)
    theirs = np.empty_like(poses)
    theirs[:, order] = poses
    np.testing.assert_allclose(rig(poses), other(theirs), atol=1e-4)
    np.testing.assert_array_equal(rig.mesh.faces, other.mesh.faces)
    np.testing.assert_array_equal(rig.file_vertices, other.file_vertices)
    points = [dict(zip(r.control_points.tolist(), r.control_point_regions, strict=True)) for r in (rig, other)]
    assert points[0] == points[1] and rig.nodes == other.nodes
    assert apart(rig, vertices, poses, np.tensordot(poses, shapes, 1)) < 1e-4
    assert has_function(rig) and len(rig.clips) == 40


def test_a_shape_is_what_a_pose_adds_for_each_unit_of_its_control(tmp_path):
    table = "".join(f"{name},0,{default},100,{name}\n" for name, default in zip(NAMES, range(6), strict=True))
    poses = np.concatenate([np.zeros((1, 6)), np.eye(6)])
    folder, vertices, shapes = write_poses(tmp_path / "a", poses, table, params=np.arange(6) + 50 * poses)
    rig = build_rig(folder)
    assert [(c.lower, c.default, c.upper, c.region) for c in rig.controls] == [
        (0, k, 100, name) for k, name in enumerate(NAMES)
    ]
    half = rig.default + np.random.default_rng(0).uniform(0, 60, (5, 6))
    assert apart(rig, vertices, half, np.tensordot((half - rig.default) / 50, shapes, 1)) < 1e-3


def test_expressions_and_clips_of_controls_in_percent_are_as_large_as_those_of_controls_from_0_to_1(tmp_path):
    table = "".join(f"{name},0,0,100,\n" for name in NAMES)
    folder, *_ = write_poses(tmp_path / "a", table=table, params=100 * np.eye(7, 6, -1))
    percent, whole = (expression_poses(build_rig(place)) for place in (folder, write_poses(tmp_path / "b")[0]))
    assert percent.keys() == whole.keys() and len(whole) > 5
    np.testing.assert_allclose([*percent.values()], 100 * np.array([*whole.values()]), rtol=1e-6)


def test_a_control_with_several_poses_goes_straight_from_one_to_the_next_and_on(tmp_path, capfd):
    at, height = [-1, -0.5, 0.5, 1], [[2, 0, 1], [-1, 3, 0], [0, 1, 1], [4, 0, 0]]
    poses, weights = np.zeros((5, 6)), np.zeros((5, 6))
    poses[1:, 0], poses[0, 1], weights[0, 1] = at, 1, 1
    weights[1:, :1] = 1
    vertices, shapes = split_sheet()[0], np.stack(list(shapes_of(split_sheet()[0], NAMES).values()))
    posed = np.array([vertices + shapes[1], *(vertices + shapes[0] * way for way in height)])
    table = f"{NAMES[0]},-2,0,2,\n" + "".join(f"{name},0,0,1,\n" for name in NAMES[1:])
    folder, *_ = write_poses(tmp_path / "a", poses, table, vertices=posed)
    rig = build_rig(folder)
    said = capfd.readouterr().err
    assert f"controls with several poses, which go straight from one to the next: {NAMES[0]}\n" in said
    assert f"controls without a pose, left out: {', '.join(NAMES[2:])}\n" in said
    assert [control.name for control in rig.controls] == list(NAMES[:2])
    ways = np.linspace(-1.5, 1.5, 25)
    knots, heights = np.array([-1, -0.5, 0, 0.5, 1]), np.insert(np.array(height, float), 2, 0, axis=0)
    slopes = (heights[[1, -1]] - heights[[0, -2]]) / 0.5
    between = np.stack([np.interp(ways, knots, heights[:, k]) for k in range(3)], axis=1)
    between += np.minimum(ways + 1, 0)[:, None] * slopes[0] + np.maximum(ways - 1, 0)[:, None] * slopes[1]
    params = np.stack([ways, np.linspace(0, 1, 25)], axis=1)
    truth = between[:, None] * shapes[0] + params[:, 1, None, None] * shapes[1]
    assert apart(rig, vertices, params, truth) < 1e-4
    save_rig(rig, tmp_path / "rig")
    np.testing.assert_array_equal(load_rig(tmp_path / "rig")(np.float32(params)), rig(np.float32(params)))
    assert np.abs(rig.run_nodes(np.float32(params), skip=["shapes"]) - rig.mesh.neutral).max() == 0


def sweep(count):
    """Return poses of a control alone, `count` of them, and one of each other."""
    return np.concatenate([np.outer(np.linspace(0.2, 1, count), np.eye(6)[0]), np.eye(6)[1:]])


@pytest.mark.parametrize(
    "poses, is_read",
    [
        (np.eye(6), True),
        (np.eye(6)[[4, 2, 2, 0]], True),
        (np.repeat(np.concatenate([np.zeros((3, 6)), np.eye(6)]), 5, axis=0), True),
        (sweep(4), True),
        (sweep(5), False),
        (np.concatenate([np.eye(6), [[1, 0, 0, 0, 1, 0]]]), False),
        (np.zeros((30, 6)), False),
        (np.eye(6) * np.nan, False),
    ],
    ids=["shapes", "some", "repeated", "in-betweens", "a sweep", "a pair", "at rest", "no numbers"],
)
def test_poses_of_one_control_a_few_each_are_shapes_and_all_others_are_samples(tmp_path, poses, is_read):
    folder, *_ = write_poses(tmp_path / "a", poses)
    assert (shape_file(str(folder)) == folder) == is_read == (sample_folder(str(folder)) is None)


def test_clips_of_shapes_are_no_animation(tmp_path, capfd):
    rest_too = np.concatenate([np.zeros((1, 6)), np.eye(6)])
    folder, *_ = write_poses(tmp_path / "a", rest_too, clip=["library"] * 7, frame=np.arange(7))
    names = [clip.name for clip in build_rig(folder).clips]
    assert "library" not in names and len(names) == 40
    assert "clips of such poses, which are no animation: one is invented: library" in capfd.readouterr().err


def test_a_face_toml_may_say_what_it_may_beside_a_glb_and_may_be_missing(tmp_path):
    folder, vertices, shapes = write_poses(tmp_path / "a")
    (folder / "face.toml").unlink()
    assert np.ptp(build_rig(folder).mesh.neutral[:, 1]) == pytest.approx(180)  # its unit is guessed
    face = f"""name = "anna"\nunit = "cm"\nup = "z"\nmesh = "mesh.obj"\neyes = [1, 2, 3]\n[limits]\n{NAMES[0]} = [0, 2]
[points]\nlandmarks = [0, 150, 215]\n[acting]\nclips = 24\n"""
    forget_folders()
    small = (vertices / 10)[:, [0, 2, 1]] * [1, -1, 1]
    posed = small + np.concatenate([0 * small[None], shapes[:, :, [0, 2, 1]] / 10 * [1, -1, 1]])
    shutil.rmtree(folder)
    folder, *_ = write_poses(folder, face=face, vertices=posed)
    (folder / "mesh.obj").write_text(mesh_text(small, split_sheet()[1]))
    rig = build_rig(folder)
    assert rig.name == "anna" and rig.controls[0].upper == 2 and len(rig.clips) == 24
    assert apart(rig, vertices, 2 * np.eye(6), 2 * shapes) < 1e-3
    shift = rig.mesh.neutral[rig.landmarks] - vertices[[0, 150, 215]]
    np.testing.assert_allclose(shift, np.array([[0, 0, 62]] * 3) - [10, 30, -20], atol=1e-3)


def test_names_and_commands_are_known_before_a_rig_is_built(tmp_path):
    folder, *_ = write_poses(tmp_path / "anna v1.2")
    recipe, files = character_parts(str(folder))
    assert [file.name for file in files] == ["mesh.obj", "controls.csv", "a.npz"]
    assert control_names(recipe, files) == list(NAMES) and recipe.name == "anna v1.2"
    assert character_label(str(folder)) == "anna_v1.2" and in_command(str(folder)) == f"'{folder}'"
    check_function([str(folder)], "make table4", "for poses")


def also_offsets(folder):
    """Write another shard that has offsets where vertices belong."""
    with np.load(folder / "poses" / "a.npz") as shard:
        np.savez(folder / "poses" / "b.npz", params=shard["params"], vertices=shard["vertices"] * 0)


def another_of_one(folder):
    with np.load(folder / "poses" / "a.npz") as shard:
        moved = shard["vertices"] + np.linspace(0, 1, len(shard["vertices"][0]))[:, None]
        np.savez(folder / "poses" / "b.npz", params=shard["params"][1:], vertices=moved[1:])


def two_meshes(folder):
    shutil.copy(folder / "mesh.obj", folder / "other.obj")
    (folder / "face.toml").unlink()


@pytest.mark.parametrize(
    "spoil, message",
    [
        (also_offsets, "a/poses/b.npz: its poses are 0 times as large as the mesh: write positions, not offsets"),
        (another_of_one, "a/poses: two poses have browInnerUp at 1 and vertices that differ by 1, expected one"),
        (two_meshes, "a: which of 2 meshes is the neutral face? call it one of neutral"),
        (lambda folder: (folder / "mesh.obj").unlink(), "a/mesh.obj: there is no such file"),
        (lambda folder: (folder / "face.toml").write_text('unit = "km"'), "a/face.toml: unit: expected guess, mm,"),
    ],
)
def test_what_contradicts_itself_is_refused_in_one_sentence_before_a_stage_starts(
    tmp_path, cache, capfd, monkeypatch, spoil, message
):
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / "results"))
    folder, *_ = write_poses(tmp_path / "a")
    spoil(folder)
    assert cli.main(["table2", "--profile", "quick", "--characters", str(folder)]) == 2
    errors = capfd.readouterr().err.strip().splitlines()
    assert len(errors) == 1 and message in errors[0]
    assert not (tmp_path / "results").exists() and not cache.exists()


def test_more_digits_than_the_mesh_has_are_those_of_the_pose_at_rest(tmp_path):
    folder, vertices, shapes = write_poses(tmp_path / "a")
    (folder / "mesh.obj").write_text(mesh_text(np.round(vertices, 1), split_sheet()[1]))
    rig = build_rig(folder)
    assert apart(rig, vertices, np.eye(6), shapes) < 1e-4
    assert np.abs(np.diff(rig.mesh.neutral[rig.file_vertices] - vertices, axis=0)).max() < 1e-3


def test_a_straight_line_is_exact_on_it(tmp_path, cache, monkeypatch):
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / "results"))
    folder, *_ = write_poses(tmp_path / "anna")
    words = ["table2", "--profile", "quick", "--numbers-only", "--methods", "linear", "neutral"]
    assert cli.main([*words, "--characters", str(folder)]) == 0
    with open(tmp_path / "results/quick/table2.csv", encoding="utf-8") as file:
        rows = {(row["method"], row["metric"]): float(row["value"]) for row in csv.DictReader(file)}
    assert rows["neutral", "vertex_error_mean"] > 0.5 and rows["linear", "vertex_error_mean"] < 5e-4


def test_samples_stay_samples(tmp_path):
    folder = sample_folders.write(tmp_path / "box")
    assert sample_folder(str(folder)) == folder and shape_file(str(folder)) is None
    (folder / "controls.csv").write_text("name\n")
    forget_folders()
    assert sample_folder(str(folder)) == folder, "what can't be read is refused as samples"
