"""Faces of shapes: sums of their shapes, their seams closed, what stands still beside them, what their files say."""

import numpy as np
import pytest
from gltf_writer import Gltf
from shape_faces import ARKIT, METRES, half, shapes_of, split_sheet, turn_round, worst_linear_mm, write_face

from data_recipes.catalogue import build_rig, character_parts, control_count, load_rig, save_rig
from data_recipes.recipe_paths import character_label, sample_folder, shape_file
from data_recipes.rig import within_limits
from data_recipes.shapes.shape_rig import prop_name
from replicate.base.exceptions import InputError


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    folder = tmp_path_factory.mktemp("face")
    vertices, shapes = write_face(folder / "head.glb")
    return folder / "head.glb", vertices, shapes, build_rig(str(folder / "head.glb"))


def test_the_rig_is_the_neutral_and_the_weighted_sum_of_the_files_shapes(built):
    _, vertices, shapes, rig = built
    assert [control.name for control in rig.controls] == list(ARKIT)
    place = rig.file_vertices[: len(vertices)]
    poses = np.random.default_rng(1).uniform(0, 1, (20, len(ARKIT))).astype(np.float32)
    moved = rig(poses)[:, place] - rig.mesh.neutral[place]
    truth = np.tensordot(poses, np.stack(list(shapes.values())), 1)
    assert np.abs(moved - truth).max() < 1e-4
    assert np.abs(np.diff(rig.mesh.neutral[place] - vertices, axis=0)).max() < 1e-4, "shifted as a whole"


def test_vertices_on_both_sides_of_a_seam_are_one(built):
    _, vertices, _, rig = built
    assert len(rig.mesh.neutral) == len(vertices) - 12
    place = rig.file_vertices
    assert len(np.unique(place[: len(vertices)])) == len(rig.mesh.neutral)
    assert (place[len(vertices) :] == -1).all(), "parts that stand still are no vertices of the rig"


def test_a_loaded_rig_says_where_the_files_vertices_are(built, tmp_path):
    _, vertices, _, rig = built
    save_rig(rig, tmp_path)
    assert len(rig.file_vertices) > len(vertices), "parts that are only shown have theirs"
    np.testing.assert_array_equal(load_rig(tmp_path).file_vertices, rig.file_vertices)


def test_vertices_that_coincide_and_move_apart_stay_two(tmp_path):
    vertices, faces, _ = split_sheet()
    g = Gltf(scene=0)
    shape = np.zeros_like(vertices)
    shape[: len(vertices) // 2, 1] = 3.0  # one half alone
    other = shapes_of(vertices, ("b",))["b"]
    targets = [{"POSITION": g.numbers(METRES * s)} for s in (shape, other)]
    g.show(g.primitive(METRES * vertices, faces, targets=targets), mesh={"extras": {"targetNames": ["a", "b"]}})
    g.add("scenes", nodes=[0])
    (tmp_path / "torn.glb").write_bytes(g.glb())
    assert len(build_rig(str(tmp_path / "torn.glb")).mesh.neutral) == len(vertices)


def test_what_stands_still_near_the_face_is_shown_and_what_is_far_is_left_out(built):
    *_, rig = built
    assert [prop[0] for prop in rig.pose_props(rig.default)] == ["eye_left"]
    assert rig.mesh.segment_names == ("Head",)


@pytest.mark.parametrize(
    ("name", "ours"),
    [
        ("EyeLeft", "eye_left"),
        ("Cornea_R", "eye_cornea_right"),
        ("Eyes", "eyes_Eyes"),
        ("Eyelashes", "brow_Eyelashes"),
        ("Wolf3D_Hair", "hair_Wolf3D_Hair"),
        ("Eyewear", "glasses_Eyewear"),
        ("TeethUpper", "TeethUpper"),
        ("", "part"),
    ],
)
def test_parts_that_are_only_shown_get_the_names_by_which_pictures_go(name, ours):
    assert prop_name(name) == ours


def test_a_folder_with_a_mesh_for_each_shape_is_the_same_rig(tmp_path, built):
    _, vertices, shapes, rig = built
    _, faces, _ = split_sheet()
    lines = "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in faces)
    for name, offset in {"neutral": 0 * vertices, **shapes}.items():
        text = "".join(f"v {x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in vertices + offset)
        (tmp_path / f"{name}.obj").write_text(text + "g Head\n" + lines)
    other = build_rig(str(tmp_path))
    order = [[c.name for c in rig.controls].index(c.name) for c in other.controls]
    poses = np.random.default_rng(2).uniform(0, 1, (5, len(ARKIT))).astype(np.float32)
    theirs = other(poses) - other.mesh.neutral
    ours = np.empty_like(poses)
    ours[:, order] = poses
    mine = rig(ours) - rig.mesh.neutral
    np.testing.assert_allclose(np.sort(theirs.ravel()), np.sort(mine.ravel()), atol=1e-4)


def test_default_weights_are_the_neutral_face(tmp_path):
    vertices, shapes = write_face(tmp_path / "a.glb", ARKIT[:4], weights=[0.5, 0, 0, 0])
    rig = build_rig(str(tmp_path / "a.glb"))
    assert rig.default.tolist() == [0.5, 0, 0, 0]
    place = rig.file_vertices[: len(vertices)]
    rest = vertices + 0.5 * shapes[ARKIT[0]]
    assert np.abs(np.diff(rig.mesh.neutral[place] - rest, axis=0)).max() < 1e-4


def test_a_saved_rig_is_loaded_as_it_was(tmp_path, built):
    *_, rig = built
    save_rig(rig, tmp_path / "rig")
    again = load_rig(tmp_path / "rig")
    pose = rig.clips[0].values[:5]
    np.testing.assert_array_equal(again(pose), rig(pose))
    assert [prop[0] for prop in again.pose_props(rig.default)] == ["eye_left"]


def test_training_poses_stay_within_the_controls_limits(built):
    *_, rig = built
    poses = np.array([[3.0] * len(ARKIT), [-1.0] * len(ARKIT)], np.float32)
    assert within_limits(rig, poses).tolist() == [[1.0] * len(ARKIT), [0.0] * len(ARKIT)]


@pytest.mark.parametrize("looks_back", [False, True])
def test_joints_turn_what_their_weights_carry(tmp_path, looks_back):
    vertices, faces, _ = split_sheet()
    g = Gltf(scene=0)
    count = len(vertices)
    upper = (vertices[:, 1] > 0).astype(float)
    joints = np.zeros((count, 4), np.uint8)
    joints[:, 1] = 1
    weights = np.stack([upper, 1 - upper, 0 * upper, 0 * upper], 1)
    shape = shapes_of(vertices, ("jawOpen",))["jawOpen"]
    attributes = {"JOINTS_0": g.numbers(joints, "u1"), "WEIGHTS_0": g.numbers(weights)}
    targets = [{"POSITION": g.numbers(METRES * shape)}]
    head = g.primitive(METRES * vertices, faces, attributes=attributes, targets=targets)
    binds = np.tile(np.eye(4), (2, 1, 1))
    binds[0, 3, :3] = (0, -0.02, 0)  # columns first, as glTF has matrices
    node = g.show(head, mesh={"extras": {"targetNames": ["jawOpen"]}}, name="Head", skin=0)
    head_joint = g.add("nodes", name="HeadTop", translation=[0, 0.02, 0])
    root = g.add("nodes", name="Root", children=[head_joint])
    g.add("skins", joints=[head_joint, root], inverseBindMatrices=g.numbers(binds.reshape(2, 16)))
    g.add("scenes", nodes=turn_round(g, [node, root]) if looks_back else [node, root])
    (tmp_path / "a.glb").write_bytes(g.glb())
    (tmp_path / "face.toml").write_text("[joints.HeadTop]\nx = [-10, 30]\n")
    rig = build_rig(str(tmp_path / "a.glb"))
    assert [(c.name, round(c.lower, 4), c.upper) for c in rig.controls] == [
        ("jawOpen", 0.0, 1.0),
        ("HeadTop_x", -0.3333, 1.0),
    ]
    pose = np.array([0.5, 1.0], np.float32)
    place = rig.file_vertices
    shift = rig.mesh.neutral[place[0]] - vertices[0]
    posed = vertices + 0.5 * shape
    angle = np.radians(30)
    turn = np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])
    turned = (posed - [0, 20, 0]) @ turn.T + [0, 20, 0]
    truth = np.where(upper[:, None] > 0, turned, posed) + shift
    np.testing.assert_allclose(rig(pose)[place], truth, atol=1e-3)


def test_a_vrm_of_the_old_kind_looks_at_the_camera_and_one_of_the_new_kind_did_already(tmp_path):
    (tmp_path / "face.toml").write_text("eyes = [0.01, 0.03, -0.04]\n")
    write_face(tmp_path / "old.vrm", looks_back=True)
    old = build_rig(str(tmp_path / "old.vrm"))
    (tmp_path / "face.toml").write_text("eyes = [-0.01, 0.03, 0.04]\n")
    write_face(tmp_path / "new.vrm")
    new = build_rig(str(tmp_path / "new.vrm"))
    poses = np.random.default_rng(3).uniform(0, 1, (5, len(ARKIT))).astype(np.float32)
    np.testing.assert_allclose(old(poses), new(poses), atol=1e-3)
    np.testing.assert_array_equal(old.mesh.faces, new.mesh.faces)
    np.testing.assert_array_equal(old.file_vertices, new.file_vertices)
    np.testing.assert_allclose(old.pose_props(old.default)[0][1], new.pose_props(new.default)[0][1], atol=1e-3)


def test_the_eyes_of_a_folder_of_shapes_are_in_its_own_axes(tmp_path):
    vertices, faces, _ = split_sheet()
    lines = "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in faces)
    middles = []
    for up, axes in (("y", [0, 1, 2]), ("z", [0, 2, 1])):
        folder, signs = tmp_path / up, np.array([1, 1, 1] if up == "y" else [1, -1, 1])
        folder.mkdir()
        for shape, offset in shapes_of(vertices, ("neutral", "smile")).items():
            moved = (vertices + offset * (shape == "smile"))[:, axes] * signs
            (folder / f"{shape}.obj").write_text("".join(f"v {x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in moved) + lines)
        eyes = (np.array([5, 30, 10])[axes] * signs).tolist()
        (folder / "face.toml").write_text(f'unit = "mm"\nup = "{up}"\neyes = {eyes}\n')
        middles.append(build_rig(str(folder)).mesh.neutral.mean(0))
    np.testing.assert_allclose(*middles, atol=1e-3)


def test_limits_in_a_face_toml_are_the_controls(tmp_path):
    write_face(tmp_path / "a.glb")
    (tmp_path / "face.toml").write_text('name = "mine"\n[limits]\njawOpen = [-0.2, 1.5]\n')
    rig = build_rig(str(tmp_path / "a.glb"))
    jaw = next(control for control in rig.controls if control.name == "jawOpen")
    assert (jaw.lower, jaw.upper, rig.name) == (-0.2, 1.5, "mine")


def test_a_unit_in_which_it_is_no_face_is_refused_and_names_of_a_face_toml_are_its_own(tmp_path):
    write_face(tmp_path / "a.glb")
    for line, words in {
        'unit = "mm"': r"a\.glb: with unit = 'mm' in face\.toml what moves is [\d.]+ mm large, expected 30 to 1,200 mm",
        "limits = { jawopened = [0, 1] }": r"a\.glb, by the face\.toml beside it: there is no control jawopened; did",
    }.items():
        (tmp_path / "face.toml").write_text(f"{line}\n")
        with pytest.raises(InputError, match=words):
            build_rig(str(tmp_path / "a.glb"))


def test_points_in_a_face_toml_are_the_files_vertices(tmp_path):
    vertices, _ = write_face(tmp_path / "a.glb")
    (tmp_path / "face.toml").write_text("[points]\nlandmarks = [0, 150, 215]\n")
    rig = build_rig(str(tmp_path / "a.glb"))
    apart = rig.mesh.neutral[rig.landmarks] - vertices[[0, 150, 215]]
    assert np.ptp(apart, axis=0).max() < 1e-3, "shifted as a whole"
    (tmp_path / "face.toml").write_text("[points]\nlandmarks = [0, 150, 300]\n")
    with pytest.raises(InputError, match=r"points.landmarks: expected vertices of the file, 0 to 431, in parts that"):
        build_rig(str(tmp_path / "a.glb"))


def test_the_unit_is_the_one_that_makes_a_face(tmp_path):
    (tmp_path / "a").mkdir()
    vertices, faces, _ = split_sheet()
    lines = "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in faces)
    for factor, name in ((0.1, "cm"), (0.001, "m")):
        folder = tmp_path / name
        folder.mkdir()
        for shape, offset in (("Neutral", 0), ("smile", 3 * np.cos(vertices / 30))):
            text = "".join(f"v {x:.7f} {y:.7f} {z:.7f}\n" for x, y, z in factor * (vertices + offset))
            (folder / f"{shape}.obj").write_text(text + lines)
        assert np.ptp(build_rig(str(folder)).mesh.neutral[:, 1]) == pytest.approx(180, rel=1e-3)


def test_counts_and_names_are_known_before_a_rig_is_built(built):
    file, *_ = built
    recipe, files = character_parts(str(file))
    assert control_count(recipe, files) == len(ARKIT) and files == (file,)
    assert character_label(str(file)) == "head" and shape_file(str(file)) == file and sample_folder(str(file)) is None


def still(folder):
    vertices, faces = half(-70, 70)
    g = Gltf(scene=0)
    g.show(g.primitive(METRES * vertices, faces), name="Head")
    g.add("scenes", nodes=[0])
    (folder / "a.glb").write_bytes(g.glb())


def small(folder):
    write_face(folder / "a.glb")
    (folder / "face.toml").write_text('unit = "furlong"\n')


def unknown(folder):
    write_face(folder / "a.glb")
    (folder / "face.toml").write_text("[limits]\njawOpn = [0, 1]\n")


def reversed_limits(folder):
    write_face(folder / "a.glb")
    (folder / "face.toml").write_text("[limits]\njawOpen = [1, 0]\n")


@pytest.mark.parametrize(
    "write, message",
    [
        (still, "no morph targets, so nothing can move"),
        (small, "unit: expected guess, mm, cm, dm, m, in or ft, got 'furlong'"),
        (unknown, "there is no control jawOpn; did you mean jawOpen"),
        (reversed_limits, r"limits.'jawOpen': expected least and greatest value around 0, such as \[0, 1\], got"),
    ],
)
def test_what_cannot_be_a_face_is_refused_in_one_sentence(tmp_path, write, message):
    write(tmp_path)
    with pytest.raises(InputError, match=message) as refused:
        build_rig(str(tmp_path / "a.glb"))
    assert "\n" not in str(refused.value)


def test_a_folder_without_a_neutral_is_told_how_to_name_it(tmp_path):
    for name in ("one", "two"):
        (tmp_path / f"{name}.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(InputError, match="which of 2 meshes is the neutral face"):
        build_rig(str(tmp_path))


def test_poses_of_an_exactly_linear_rig_are_on_a_line(built):
    *_, rig = built
    shapes = np.stack([rig(np.eye(len(ARKIT), dtype=np.float32)[k]) - rig.mesh.neutral for k in range(len(ARKIT))])
    frames = np.concatenate([clip.values for clip in rig.clips])[::50]
    assert worst_linear_mm(rig, frames, shapes) < 1e-4


def test_a_path_with_a_slip_gets_the_name_that_is_there(built):
    file = built[0]
    with pytest.raises(InputError, match=r"haed\.glb: there is no such file; did you mean head\.glb\?"):
        build_rig(str(file.with_name("haed.glb")))
    with pytest.raises(InputError, match=r"other_face\.glb: there is no such file$"):
        build_rig(str(file.with_name("other_face.glb")))
