"""The example for Blender: numpy gives Python's vertices, and keyed properties move the mesh, where there is bpy."""

import importlib.util
import json
import subprocess
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from posed_face import PosedRig, posed_face
from small_face import M
from untrained_models import MESH, MODELS

from data_recipes.exporters.blender_python import blender_python, script_command
from replicate.approximation.rigid import attach
from replicate.base.exceptions import InputError
from replicate.base.paths import ROOT
from replicate.deployment.onnx_model import onnx_model
from replicate.export.files import glb, posed_parts

SCRIPT, KEYS = ROOT / "examples" / "blender_face.py", ROOT / "tests" / "deployment" / "blender_poses.py"
ATTACHMENTS = posed_face().attachments
POSES = np.random.default_rng(0).uniform(-3, 3, (100, M)).astype(np.float32)  # the limits are −1 and 2


def written(folder, kind, half=False):
    """Write a model and its mesh as `make deploy` does; return the model's file."""
    controls = [dict(vars(control)) for control in PosedRig.controls]
    about = {"character": "small", "controls": json.dumps(controls)}
    file = folder / "deploy_small_model.onnx"
    file.write_bytes(onnx_model(MODELS[kind](), MESH, ATTACHMENTS, half, about).SerializeToString())
    (folder / "deploy_small.glb").write_bytes(glb([posed_parts(PosedRig(), PosedRig.default)[0]], {}))
    return file


def wanted(kind):
    return attach(MESH, ATTACHMENTS, MESH.neutral + MODELS[kind]().offsets(POSES))


@pytest.fixture
def example(monkeypatch):
    """The example as a module, without Blender."""
    names = ("bpy", "bpy.app", "bpy.app.handlers", "bpy_extras", "bpy_extras.io_utils")
    modules = {name: ModuleType(name) for name in names}
    modules["bpy"].types = SimpleNamespace(**{name: type(name, (), {}) for name in ("Operator", "Panel")})
    modules["bpy"].props = SimpleNamespace(StringProperty=lambda **_: None)
    modules["bpy.app.handlers"].persistent = lambda function: function
    modules["bpy_extras.io_utils"].ImportHelper = type("ImportHelper", (), {})
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location("blender_face", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("kind", MODELS)
def test_numpy_alone_gives_pythons_vertices(kind, example, tmp_path):
    found = example.Model(written(tmp_path, kind, half=kind == "regional"))(POSES)
    assert found.dtype == np.float32 and np.linalg.norm(found - wanted(kind), axis=-1).max() < 1e-3


def test_long_names_of_controls_become_different_properties(example):
    names = ["jaw", "a" * 63, "a" * 64, "a" * 64 + "b", "ä" * 40]
    model = SimpleNamespace(controls=[{"name": name} for name in names])
    found = example.properties(model)
    assert found[:2] == names[:2] and len(set(found)) == 5 and max(len(name.encode()) for name in found) <= 63


@pytest.fixture(scope="module")
def python():
    try:
        return blender_python()
    except InputError as error:
        pytest.skip(str(error))


@pytest.mark.parametrize("kind", ["coarse", "regional"])
def test_keyed_properties_move_the_mesh_in_blender(kind, python, tmp_path):
    file, params, out = written(tmp_path, kind), tmp_path / "params.npy", tmp_path / "out.npz"
    np.save(params, POSES)
    command = script_command(python, KEYS, [str(SCRIPT), str(file), str(params), str(out)])
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    found, poses = np.load(out), wanted(kind)
    assert np.linalg.norm(in_mm(found["keyed"]) - poses, axis=-1).max() < 1e-3
    assert np.linalg.norm(in_mm(found["by_hand"]) - poses[3], axis=-1).max() < 1e-3
    assert np.linalg.norm(in_mm(found["rest"]) - poses[3], axis=-1).max() > 1
    np.testing.assert_allclose(found["limits"], [[-1, 0, 2]] * M)


def in_mm(vertices):
    """Return Blender's vertices, metres with z up, in mm with y up."""
    return 1000 * np.stack([vertices[..., 0], vertices[..., 2], -vertices[..., 1]], axis=-1)


def test_a_model_without_its_mesh_is_refused_in_a_sentence(python, tmp_path):
    file = written(tmp_path, "linear")
    (tmp_path / "deploy_small.glb").unlink()
    np.save(tmp_path / "params.npy", POSES)
    arguments = [str(SCRIPT), str(file), str(tmp_path / "params.npy"), str(tmp_path / "out.npz")]
    done = subprocess.run(script_command(python, KEYS, arguments), capture_output=True, text=True, timeout=300)
    assert done.returncode == 1 and not (tmp_path / "out.npz").exists()
    assert "deploy_small.glb has to lie beside deploy_small_model.onnx: make deploy writes both" in done.stderr
