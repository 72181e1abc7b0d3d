"""Exported files, opened again: what is in them is what the rig says, clips within the distance that was promised."""

import errno
import json
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rigs
import trimesh
from refusal import refusal

from data_recipes.catalogue import expression_poses
from data_recipes.controls import Control
from data_recipes.function_rig import FunctionRig
from data_recipes.rig import Clip
from replicate import __main__ as cli
from replicate.base.exceptions import InputError
from replicate.cli.options import OPTIONS
from replicate.export.animation import follow, low_rank
from replicate.export.files import write_whole
from replicate.geometry.mesh import Mesh, vertex_normals
from replicate.targets import export as command
from replicate.targets.export import Request, export, requested_poses

DTYPES = {5121: "<u1", 5125: "<u4", 5126: "<f4"}
COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


def tiny() -> FunctionRig:
    return rigs.rig("tiny")


class Glb:
    """A GLB, read by nothing but the format's description."""

    def __init__(self, file: Path):
        data = file.read_bytes()
        magic, version, length, size, kind = np.frombuffer(data[:20], "<u4")
        assert (magic, version, length, kind) == (0x46546C67, 2, len(data), 0x4E4F534A)
        self.tree = json.loads(data[20 : 20 + size])
        binary_size, binary_kind = np.frombuffer(data[20 + size : 28 + size], "<u4")
        assert binary_kind == 0x004E4942 and 28 + size + binary_size == len(data)
        self.binary = data[28 + size :]

    def array(self, index: int) -> np.ndarray:
        accessor = self.tree["accessors"][index]
        view, columns = self.tree["bufferViews"][accessor["bufferView"]], COLUMNS[accessor["type"]]
        first = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        dtype = np.dtype(DTYPES[accessor["componentType"]])
        assert first % dtype.itemsize == 0
        assert accessor["count"] * columns * dtype.itemsize <= view["byteLength"]
        values = np.frombuffer(self.binary, dtype, accessor["count"] * columns, first).reshape(-1, columns)
        np.testing.assert_allclose(values.min(0), accessor["min"], rtol=1e-6)
        np.testing.assert_allclose(values.max(0), accessor["max"], rtol=1e-6)
        return values

    def play(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return a node's vertices (t, n, 3) in mm and its unit normals in every frame of the animation."""
        (node,) = (k for k, node in enumerate(self.tree["nodes"]) if node.get("name") == name)
        (primitive,) = self.tree["meshes"][self.tree["nodes"][node]["mesh"]]["primitives"]
        rest, normals = (self.array(primitive["attributes"][kind]) for kind in ("POSITION", "NORMAL"))
        (animation,) = self.tree["animations"]
        (sampler,) = (
            animation["samplers"][channel["sampler"]]
            for channel in animation["channels"]
            if channel["target"] == {"node": node, "path": "weights"}
        )
        times = self.array(sampler["input"])[:, 0]
        np.testing.assert_allclose(times, np.arange(len(times)) / 24, rtol=1e-6)
        weights = self.array(sampler["output"]).reshape(len(times), -1)
        assert np.abs(weights).max() <= 1 + 1e-6 and sampler["interpolation"] == "LINEAR"
        targets = primitive["targets"]
        assert weights.shape[1] == len(targets) == len(self.tree["meshes"][self.tree["nodes"][node]["mesh"]]["weights"])
        moved = rest + np.einsum("tk,knc->tnc", weights, [self.array(target["POSITION"]) for target in targets])
        turned = normals + np.einsum("tk,knc->tnc", weights, [self.array(target["NORMAL"]) for target in targets])
        return 1000 * moved, turned / np.linalg.norm(turned, axis=-1, keepdims=True)


def angles_deg(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.degrees(np.arccos(np.clip((one * other).sum(-1), -1, 1)))


def linear(colour) -> np.ndarray:
    value = np.array(colour) / 255
    return 255 * np.where(value < 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


# -- poses -------------------------------------------------------------------------------------------------------


def test_a_glb_opened_again_is_the_pose_in_metres(tmp_path):
    rig, file = tiny(), tmp_path / "joy.glb"
    files, words = export(rig, Request(pose="joy", to=str(file)))
    assert files == [file] and words.startswith("918 vertices and 14 props")
    trimesh.exchange.gltf.validate(Glb(file).tree)
    scene = trimesh.load_scene(file)
    params = expression_poses(rig)["joy"]
    head, vertices = scene.geometry["tiny"], rig(params)
    np.testing.assert_allclose(1000 * head.vertices, vertices, atol=1e-4)
    assert np.abs(vertices - rig.mesh.neutral).max() > 3
    np.testing.assert_array_equal(head.faces, rig.mesh.faces)
    np.testing.assert_allclose(head.visual.uv, rig.mesh.uv, atol=1e-6)
    np.testing.assert_allclose(head.vertex_normals, vertex_normals(vertices, rig.mesh.faces), atol=1e-5)
    colours = head.visual.vertex_attributes["color"]
    assert np.abs(colours[:, :3] - linear(rig.paint)).max() < 0.51
    props = {name: (vertices, faces) for name, vertices, faces, _ in rig.pose_props(params)}
    assert set(scene.geometry) == {"tiny", *props}
    for name, (vertices, faces) in props.items():
        np.testing.assert_allclose(1000 * scene.geometry[name].triangles, vertices[faces], atol=1e-4)


def test_an_obj_opened_again_is_the_pose_in_millimetres_with_a_material_a_part(tmp_path):
    rig, file = tiny(), tmp_path / "joy.obj"
    files, _ = export(rig, Request(pose="joy", to=str(file)))
    assert files == [file, tmp_path / "joy.mtl"]
    assert "tiny, joy; millimetres" in file.read_text().splitlines()[0]
    params = expression_poses(rig)["joy"]
    vertices, segment = rig(params), rig.mesh.face_segment
    scene = trimesh.load_scene(file, split_objects=True, process=False)
    triangles = np.concatenate([mesh.triangles for mesh in scene.geometry.values()])
    props = rig.pose_props(params)
    expected = np.concatenate([vertices[rig.mesh.faces], *(places[faces] for _, places, faces, _ in props)])
    assert len(triangles) == len(expected)
    np.testing.assert_allclose(triangles.mean(0), expected.mean(0), atol=1e-3)
    teeth = scene.geometry["tiny_tooth_tiny_tooth"]  # object and material
    is_tooth = np.array([name.startswith("tooth") for name in rig.mesh.segment_names])[segment]
    np.testing.assert_allclose(teeth.triangles, vertices[rig.mesh.faces[is_tooth]], atol=1e-4)
    used = np.unique(rig.mesh.faces[is_tooth])
    assert np.abs(teeth.visual.material.diffuse[:3] - np.median(rig.paint[used], axis=0)).max() <= 1
    np.testing.assert_allclose(teeth.visual.uv, rig.mesh.uv[used], atol=1e-5)
    normals = vertex_normals(vertices, rig.mesh.faces)
    np.testing.assert_allclose(teeth.vertex_normals, normals[used], atol=1e-4)
    places, faces = next((places, faces) for name, places, faces, _ in props if name == "hair")
    np.testing.assert_allclose(scene.geometry["hair_hair"].triangles, places[faces], atol=1e-4)


# -- clips -------------------------------------------------------------------------------------------------------


def test_an_animated_glb_plays_every_frame_within_the_stated_distance(tmp_path):
    rig, file = tiny(), tmp_path / "clip.glb"
    poses = rig.clips[15].values[::6]
    short = replace(rig, clips=(Clip("speech", poses),))
    _, words = export(short, Request(clip="0", to=str(file), tolerance_mm=0.02))
    glb = Glb(file)
    trimesh.exchange.gltf.validate(glb.tree)
    vertices, normals = glb.play("tiny")
    expected = rig(poses)
    off = np.linalg.norm(vertices - expected, axis=-1)
    assert off.max() < 0.0202
    said = float(re.search(r"no vertex more than ([\d.]+) mm off", words).group(1))
    assert words.startswith(f"{len(poses)} frames at 24 a second") and off.max() - 6e-4 < said <= 0.02
    assert np.linalg.norm(expected - expected[0], axis=-1).max() > 5
    turned = angles_deg(normals, vertex_normals(expected, rig.mesh.faces))
    assert turned.mean() < 0.1 and angles_deg(normals, normals[:1]).mean() > 1
    count = len(glb.tree["meshes"][0]["weights"])
    assert 3 < count < len(poses)
    for name in ("eye_pupil_left", "brow_right"):
        posed = np.array([{n: v[np.unique(f)] for n, v, f, _ in rig.pose_props(p)}[name] for p in poses])
        assert np.linalg.norm(glb.play(name)[0] - posed, axis=-1).max() < 0.0202
    scene = trimesh.load_scene(file)
    np.testing.assert_allclose(1000 * scene.geometry["tiny"].vertices, rig.mesh.neutral, atol=1e-3)


def test_a_basis_keeps_its_promise_and_a_looser_one_is_smaller():
    generator = np.random.default_rng(1)
    smooth = np.einsum("tk,knc->tnc", generator.normal(size=(40, 5)), generator.normal(size=(5, 30, 3)))
    offsets = (smooth + 0.05 * generator.normal(size=(40, 30, 3))).astype(np.float32)
    sizes = []
    for tolerance in (0.4, 0.1, 0.01):
        basis = low_rank(offsets, tolerance)
        off = np.linalg.norm(np.einsum("tk,knc->tnc", basis.weights, basis.shapes) - offsets, axis=-1)
        assert off.max() == pytest.approx(basis.error_mm, rel=1e-3, abs=1e-5) and off.max() <= tolerance
        assert np.abs(basis.weights).max() <= 1 + 1e-6
        sizes.append(len(basis.shapes))
    assert 5 <= sizes[0] < sizes[1] < sizes[2] <= 40
    still = low_rank(np.full((7, 3, 3), 1e-4, np.float32), 0.01)
    assert still.weights.shape == (7, 0) and still.shapes.shape == (0, 3, 3)


def test_other_values_follow_the_weights_by_least_squares():
    generator = np.random.default_rng(2)
    weights = generator.normal(size=(20, 3)).astype(np.float32)
    shapes = generator.normal(size=(3, 6, 3)).astype(np.float32)
    values = np.einsum("tk,knc->tnc", weights, shapes).astype(np.float32)
    np.testing.assert_allclose(follow(weights, values), shapes, atol=1e-4)


# -- what is asked for -------------------------------------------------------------------------------------------


def foreign(clips=None) -> FunctionRig:
    """A rig of a user's own, without props."""
    mesh = Mesh(np.float32([[0, 0, 0], [10, 0, 0], [0, 10, 0]]), np.int32([[0, 1, 2]]),
                np.float32([[0, 0], [1, 0], [0, 1]]), np.zeros(3, np.int32), ("all",))  # fmt: skip
    controls = (Control("lift", 0.0, 0.0, 1.0, "all"),)
    return FunctionRig("box", mesh, controls, np.array([0]), np.array([1]), ("all",), clips,
               lambda p: mesh.neutral + p[:, :, None] * np.float32([0, 0, 5]))  # fmt: skip


def test_a_file_of_parameters_is_a_pose_or_a_clip(tmp_path):
    rig, params = foreign(), tmp_path / "nod.csv"
    params.write_text("lift\n0.5\n")
    export(rig, Request(params=str(params), to=str(tmp_path / "one.glb")))
    (mesh,) = trimesh.load_scene(tmp_path / "one.glb").geometry.values()
    np.testing.assert_allclose(1000 * mesh.vertices[:, 2], 2.5, rtol=1e-5)
    params.write_text("lift\n0\n0.5\n1\n")
    export(rig, Request(params=str(params), to=str(tmp_path / "three.glb")))
    np.testing.assert_allclose(Glb(tmp_path / "three.glb").play("box")[0][:, 0, 2], [0, 2.5, 5], atol=0.05)
    with pytest.raises(InputError, match=r"three\.obj can hold one pose, and nod has 3: name a \.glb or \.usdc file"):
        export(rig, Request(params=str(params), to=str(tmp_path / "three.obj")))
    params.write_text("lft\n0.5\n")
    with pytest.raises(InputError, match="there is no control 'lft' in this rig"):
        export(rig, Request(params=str(params), to=str(tmp_path / "two.glb")))
    assert sorted(os.listdir(tmp_path)) == ["nod.csv", "one.glb", "three.glb"]


def test_poses_and_clips_go_by_their_names_and_clips_by_their_numbers_too():
    rig = foreign((Clip("nod", np.zeros((2, 1))), Clip("12", np.ones((3, 1)))))
    assert [requested_poses(rig, Request(clip=clip))[0] for clip in ("nod", "0", "00", "1", "12")] == [
        "nod", "nod", "nod", "12", "12",
    ]  # fmt: skip
    assert requested_poses(rig, Request())[0] == "neutral"
    with pytest.raises(InputError, match=r"no clip '2'; it has nod, 12, numbered from 0 to 1"):
        requested_poses(rig, Request(clip="2"))
    with pytest.raises(InputError, match="box has no pose 'joy'; it has neutral"):
        requested_poses(rig, Request(pose="joy"))
    with pytest.raises(InputError, match="box has no clips"):
        requested_poses(foreign(), Request(clip="0"))


@pytest.mark.parametrize(
    "arguments, part",
    [
        (("--pose", "joy", "--clip", "3"), "expected one of pose, clip and params, got pose and clip"),
        (("--to", "face.fbx"), "face.fbx: expected a name that ends in .glb, .obj, .usd, .usda, .usdc or .abc"),
        (("--to", "face"), "face: expected a name that ends in .glb, .obj, .usd, .usda, .usdc or .abc"),
        (("--to", "nowhere/at/all/face.glb"), "there is no folder"),
        (("--clip", "3", "--to", "face.obj"), "can hold one pose and not a clip: name a .glb or .usdc file"),
        (("--clip", "3", "--tolerance", "0"), "tolerance: expected a number of at least 0.001 mm, got 0.0"),
        (("--tolerance", "nan"), "tolerance: expected a number of at least 0.001 mm, got nan"),
        (("--characters", "teen", "tiny", "--to", "face.glb"), "2 characters can't all be written to face.glb"),
        (("--characters", "hiccup"), "Hiccup's part is played by the teen"),
    ],
)
def test_what_can_not_be_is_refused_before_a_rig_is_built(capsys, cache, arguments, part):
    assert part in refusal(capsys, "export", *arguments)
    assert not cache.exists()


def test_the_command_writes_where_results_go(capsys, monkeypatch, tmp_path):
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path))
    monkeypatch.setattr("replicate.methods.artefacts.rig_of", lambda character: foreign())
    assert cli.main(["export", "--characters", "tiny"]) == 0
    assert "box_neutral.glb: 3 vertices and 0 props" in capsys.readouterr().out
    assert len(Glb(tmp_path / "export" / "box_neutral.glb").tree["meshes"]) == 1


@pytest.mark.parametrize("code, error", [(errno.ENOSPC, OSError), (errno.EACCES, InputError)])
def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(monkeypatch, tmp_path, code, error):
    file = tmp_path / "face.glb"
    file.write_bytes(b"old")

    def half(self, data):
        with open(self, "wb") as stream:
            stream.write(data[: len(data) // 2])
        raise OSError(code, "no", str(self))

    monkeypatch.setattr(Path, "write_bytes", half)
    with pytest.raises(error):
        write_whole(file, b"a new one")
    assert file.read_bytes() == b"old" and os.listdir(tmp_path) == ["face.glb"]


def test_the_help_says_the_tolerance_that_is_used():
    assert OPTIONS["tolerance"]["default"] == command.TOLERANCE_MM
