"""The exporter for Blender, run on a small file of its own in a Python with bpy or in Blender; skipped without one."""

import csv
import subprocess
import tomllib
from pathlib import Path

import numpy as np
import pytest

from data_recipes.exporters import blender_samples
from data_recipes.exporters.blender_python import blender_python, script_command
from replicate.base.exceptions import InputError

SCRIPT = Path(blender_samples.__file__)
MAKER, AVATAR = (Path(__file__).with_name(name) for name in ("small_blend.py", "avatar_blend.py"))
ALL = ("--bones", "*", "--shape-keys", "*", "--properties", "*", "--poses", "60")


@pytest.fixture(scope="session")
def python():
    try:
        return blender_python()
    except InputError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def blend(python, tmp_path_factory):
    """Return the function that makes a variant of the small file, once each."""
    folder = tmp_path_factory.mktemp("blend")

    def make(extra, maker=MAKER):
        file = folder / f"{maker.stem}_{extra}.blend"
        if not file.exists():
            command = script_command(python, maker, [str(file), extra])
            subprocess.run(command, check=True, capture_output=True, timeout=300)
        return file

    return make


@pytest.fixture(scope="session")
def call(python):
    def run(file, folder, *options, meshes=("Sheet",)):
        named = [word for mesh in meshes for word in ("--mesh", mesh)]
        command = script_command(python, SCRIPT, [str(file), *named, "--out", str(folder), *options])
        ended = subprocess.run(command, capture_output=True, text=True, timeout=300)
        return ended.returncode, ended.stderr.strip().splitlines()

    return run


@pytest.fixture(scope="module")
def moving(blend, call, tmp_path_factory):
    """Return the folder of the sheet that moves."""
    folder = tmp_path_factory.mktemp("folder") / "sheet"
    code, lines = call(blend("moving"), folder, *ALL)
    assert code == 0, lines
    return folder


def poses_of(folder):
    shards = [np.load(path) for path in sorted((folder / "poses").iterdir())]
    return {key: np.concatenate([shard[key] for shard in shards]) for key in shards[0]}


def controls_of(folder):
    with open(folder / "controls.csv", encoding="utf-8") as file:
        return {row["name"]: row for row in csv.DictReader(file)}


def neutral_of(folder):
    lines = (folder / "mesh.obj").read_text().splitlines()
    return np.array([[float(x) for x in line.split()[1:]] for line in lines if line.startswith("v ")])


def rotation(vector):
    """Return the matrix of a rotation vector (Rodrigues)."""
    angle = np.linalg.norm(vector)
    x, y, z = vector / max(angle, 1e-12)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def euler(x, y, z):
    return rotation(np.array([0, 0, z])) @ rotation(np.array([0, y, 0])) @ rotation(np.array([x, 0, 0]))


REST = {-0.05: "left", 0.05: "right"}
TO_WORLD = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # of a bone that points up: its y is the world's z


def closed_form(neutral, p):
    """Return what the small rig does, from the values of its controls by name."""
    offset = 0.02 * (1 - 100 * neutral[:, 0] ** 2)
    posed = neutral + np.stack([np.zeros(len(neutral)), p["Puff"] * offset, np.clip(p["lift"], 0, 1) * offset], 1)
    result = posed.copy()
    for x, name in REST.items():
        angles = np.radians([p.get(f"{name}.rotation_{axis}", 0.0) for axis in "xyz"])
        moved = np.array([p.get(f"{name}.location_{axis}", 0.0) for axis in "xyz"])
        if name == "left":
            moved[0] = np.clip(moved[0], -0.02, 0.02)
        scale = np.diag([p.get(f"{name}.scale_{axis}", 1.0) for axis in "xyz"])
        turn = TO_WORLD @ (euler(*angles) if name == "left" else rotation(angles)) @ scale @ TO_WORLD.T
        head = np.array([x, 0.0, 0.5])
        own = neutral[:, 0] < 0 if name == "left" else neutral[:, 0] >= 0
        result[own] = (posed[own] - head) @ turn.T + head + TO_WORLD @ moved
    return result


def test_every_pose_is_what_bones_keys_and_driven_properties_make_of_the_mesh(moving):
    names, neutral, poses = list(controls_of(moving)), neutral_of(moving), poses_of(moving)
    assert len(poses["params"]) == 11 + 15 + 5 + 60
    for params, vertices in zip(poses["params"], poses["vertices"], strict=True):
        expected = closed_form(neutral, dict(zip(names, params.tolist(), strict=True)))
        np.testing.assert_allclose(vertices, expected, atol=2e-6)
    assert np.abs(poses["vertices"] - neutral).max(axis=(1, 2)).min() < 1e-6  # some frames are at rest
    assert np.abs(poses["vertices"] - neutral).max() > 0.02


def test_controls_are_the_free_channels_with_the_rigs_limits(moving):
    controls = controls_of(moving)
    assert not any(name.startswith("right.location_") and not name.endswith("x") for name in controls)  # locked
    assert "Lift" not in controls  # driven
    lower, upper = (float(controls["left.location_x"][key]) for key in ("lower", "upper"))
    assert (lower, upper) == pytest.approx((-0.02, 0.02))
    assert [float(controls["lift"][key]) for key in ("lower", "default", "upper")] == [-1.0, 0.0, 2.0]
    assert float(controls["right.scale_y"]["default"]) == 1.0


def test_actions_are_clips_with_all_of_their_frames(moving):
    poses, names = poses_of(moving), list(controls_of(moving))
    frames = ~poses["drawn"]
    lengths = {clip: int((poses["clip"][frames] == clip).sum()) for clip in set(poses["clip"].tolist())}
    assert lengths == {"nod": 11, "turn": 15, "puff": 5}
    at = frames & (poses["clip"] == "turn") & (poses["frame"] == 9)
    turned = dict(zip(names, poses["params"][at][0].tolist(), strict=True))
    assert turned["right.rotation_y"] == pytest.approx(np.degrees(2 * np.arccos(0.9)), abs=1e-3)
    assert turned["right.location_x"] == pytest.approx(0.01)
    assert turned["left.rotation_x"] == 0.0


def test_drawn_poses_are_multiples_of_their_frames_within_limits(moving):
    poses, names = poses_of(moving), list(controls_of(moving))
    frames = {
        (clip, frame): params
        for clip, frame, params, drawn in zip(*(poses[k] for k in ("clip", "frame", "params", "drawn")), strict=True)
        if not drawn
    }
    column = names.index("left.rotation_x")
    for i in np.flatnonzero(poses["drawn"]):
        own = frames[poses["clip"][i], poses["frame"][i]]
        assert 0.249 * own[column] <= poses["params"][i, column] <= 3.001 * own[column]
        assert abs(poses["params"][i, names.index("left.location_x")]) <= 0.02 + 1e-6


def test_the_mesh_keeps_its_quads_and_their_places_in_the_charts(moving):
    text = (moving / "mesh.obj").read_text().splitlines()
    faces = [line.split()[1:] for line in text if line.startswith("f ")]
    assert len(faces) == 16 * 16 and all(len(face) == 4 for face in faces)
    places = np.array([[float(x) for x in line.split()[1:]] for line in text if line.startswith("vt ")])
    neutral = neutral_of(moving)
    for corner in faces[0] + faces[-1]:
        vertex, place = (int(number) - 1 for number in corner.split("/"))
        np.testing.assert_allclose(places[place], neutral[vertex, [0, 2]] * 5 + 0.5 - (0, 2.5), atol=1e-5)
    about = tomllib.loads((moving / "face.toml").read_text())
    assert (about["unit"], about["up"], about["segments"]) == ("m", "z", "islands")


def test_a_second_call_goes_on_and_changes_nothing(moving, blend, call):
    before = {path.name: path.read_bytes() for path in (moving / "poses").iterdir()}
    code, _ = call(blend("moving"), moving, *ALL[:-1], "90")
    assert code == 0
    after = {path.name: path.read_bytes() for path in (moving / "poses").iterdir()}
    assert before.items() <= after.items() and len(after) == len(before) + 1


def test_without_patterns_what_actions_move_are_the_controls(blend, call, tmp_path):
    code, lines = call(blend("moving"), tmp_path / "sheet", "--poses", "0")
    assert code == 0, lines
    names = set(controls_of(tmp_path / "sheet"))
    assert {"Puff", "lift", "left.rotation_x", "right.location_x", "right.rotation_y"} <= names
    assert not any("scale" in name for name in names) and "left.location_y" not in names  # keyed, but never moved


def test_without_animation_poses_reach_the_limits(blend, call, tmp_path):
    folder = tmp_path / "sheet"
    code, lines = call(blend("still"), folder, "--properties", "*", "--shape-keys", "*", "--poses", "200")
    assert code == 0, lines
    poses = poses_of(folder)
    assert set(poses) == {"params", "vertices"}
    lift = poses["params"][:, list(controls_of(folder)).index("lift")]
    assert -1.0 <= lift.min() < -0.8 and 1.8 < lift.max() <= 2.0


@pytest.fixture(scope="module")
def avatar(blend, call, tmp_path_factory):
    """Return the function that exports a variant of the avatar: its folder and the lines that were said."""
    made = {}

    def export(variant, *options):
        if (variant, options) not in made:
            folder = tmp_path_factory.mktemp("avatar") / variant
            words = options or ("--shape-keys", "*", "--properties", "*", "--poses", "80")
            code, lines = call(blend(variant, AVATAR), folder, *words, meshes=SHEETS)
            assert code == 0, lines
            made[variant, options] = folder, lines
        return made[variant, options]

    return export


SHEETS = {"Head": 0.2, "Teeth": 0.06, "Eye": 0.03}  # mesh → its edge
OFFSETS = {
    "Head": {"jawOpen": (0, 0, -0.02), "jawLeft": (0.01, 0, 0), "jawRight": (-0.01, 0, 0), "lookUp": (0, 0.001, 0.002),
             "browInnerUp": (0, -0.004, 0.01), "wrinkle": (0, -0.006, 0)},
    "Teeth": {"jawOpen": (0, 0, -0.018), "jawLeft": (0.009, 0, 0), "jawRight": (-0.009, 0, 0)},
    "Eye": {"lookUp": (0, 0, 0.005), "lookDown": (0, 0, -0.005)},
}  # fmt: skip


def posed_avatar(neutral, values):
    """Return what the avatar does, from the values of its controls by name."""
    values = values | {"wrinkle": values.get("strength", 0.0) * values["browInnerUp"]}
    parts = []
    for (mesh, edge), part in zip(SHEETS.items(), np.split(neutral, 3), strict=True):
        offset = sum((values.get(key, 0.0) * np.array(of_key) for key, of_key in OFFSETS[mesh].items()), np.zeros(3))
        bump = 1 - (2 * part[:, :1] / edge) ** 2 if mesh == "Head" else 1.0
        parts.append(part + bump * offset)
    return np.concatenate(parts)


@pytest.mark.parametrize("variant", ["still", "driven", "acted"])
def test_shape_keys_with_one_name_are_one_control_that_moves_all_meshes(variant, avatar):
    folder, lines = avatar(variant)
    names = list(controls_of(folder))
    assert names == ["jawOpen", "jawLeft", "jawRight", "lookUp", "browInnerUp", "lookDown", "strength"]
    neutral, poses = neutral_of(folder), poses_of(folder)
    for params, vertices in zip(poses["params"], poses["vertices"], strict=True):
        expected = posed_avatar(neutral, dict(zip(names, params.tolist(), strict=True)))
        np.testing.assert_allclose(vertices, expected, atol=2e-6)
    (line,) = (line for line in lines if "now one control each" in line)
    meshes = "jawOpen, lookUp (Head, Eye)" if variant == "driven" else "jawOpen (Head, Teeth, Eye)"
    assert meshes in line and "jawLeft, jawRight, empty (Head, Teeth)" in line


def test_controls_that_move_nothing_are_named_and_left_out_and_those_that_act_with_others_stay(avatar):
    folder, lines = avatar("still")
    (line,) = (line for line in lines if "move no vertex" in line)
    assert line.endswith(": empty, mood") and "strength" in controls_of(folder)


def test_without_animation_few_shape_keys_move_at_a_time_and_left_is_not_right(avatar):
    folder, _ = avatar("still")
    names, params = list(controls_of(folder)), poses_of(folder)["params"]
    assert set(poses_of(folder)) == {"params", "vertices"}
    assert 1 <= (params > 0).sum(axis=1).min() and (params > 0).sum(axis=1).mean() < 3
    for first, second in (("jawLeft", "jawRight"), ("lookUp", "lookDown")):
        moved = params[:, [names.index(first), names.index(second)]] > 0
        assert moved.any(axis=0).all() and not moved.all(axis=1).any()


def test_the_teeths_part_of_a_take_is_no_clip_of_its_own(avatar):
    folder, lines = avatar("acted", "--poses", "0")
    assert list(controls_of(folder)) == ["jawOpen", "lookUp", "browInnerUp", "lookDown"]
    poses = poses_of(folder)
    assert set(poses["clip"].tolist()) == {"talk", "look"} and len(poses["clip"]) == 21 + 12
    assert poses["params"][(poses["clip"] == "talk") & (poses["frame"] == 11), 0] == pytest.approx(1.0)
    assert any(line.endswith("all that they move is in another one: talk of the teeth") for line in lines)


def test_a_joined_control_goes_as_far_as_its_largest_slider_and_each_mesh_as_far_as_its_own(avatar):
    folder, _ = avatar("limits", "--shape-keys", "jawOpen", "--poses", "60")
    assert [float(controls_of(folder)["jawOpen"][key]) for key in ("lower", "default", "upper")] == [0, 0, 2]
    poses, neutral = poses_of(folder), neutral_of(folder)
    jaw = poses["params"][:, 0]
    assert jaw.max() > 1.5
    lowest = (poses["vertices"] - neutral)[:, :, 2]
    np.testing.assert_allclose(lowest[:, :81].min(axis=1), -0.02 * jaw, atol=2e-6)
    np.testing.assert_allclose(lowest[:, 81:162].min(axis=1), -0.018 * np.minimum(jaw, 0.5), atol=2e-6)


def test_names_that_blender_may_have_cut_to_one_are_named(avatar):
    _, lines = avatar("long")
    (line,) = (line for line in lines if line.startswith("Blender cuts names"))
    assert line.endswith("in_front_of__")
    assert not any("Blender cuts names" in line for line in avatar("still")[1])


def test_a_subdivision_is_switched_off_and_said(blend, call, tmp_path):
    code, lines = call(blend("subdivided"), tmp_path / "sheet", *ALL[:-1], "0")
    assert code == 0 and any("Finer is switched off" in line for line in lines)
    assert len(neutral_of(tmp_path / "sheet")) == 17 * 17


@pytest.mark.parametrize(
    ("extra", "options", "words"),
    [
        ("thick", ALL, "578 behind its modifiers (Armature, Thicker)"),
        ("loose", ALL, "3 vertices without a face"),
        ("moving", ("--mesh", "Nose"), "no mesh 'Nose'"),
        ("moving", ("--armature", "Arms"), "no armature 'Arms'"),
        ("moving", ("--bones", "nobody"), "no control is left"),
        ("moving", (*ALL, "--unit", "in"), "give the unit of the scene by --unit"),
        ("moving", ("--share", "3/2"), "--share: expected a part such as 1/2 or 2/2, got 3/2"),
        ("still", (), "no action moves anything"),
    ],
)
def test_what_cannot_be_exported_is_refused_in_one_sentence(extra, options, words, blend, call, tmp_path):
    code, lines = call(blend(extra), tmp_path / "sheet", *options)
    assert code == 2, lines
    errors = [line for line in lines if line.startswith("error: ")]
    assert len(errors) == 1 and words in errors[0] and errors[0] == lines[-1]
    assert not (tmp_path / "sheet").exists()
