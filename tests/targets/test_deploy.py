"""`make deploy` on the stand-in face: models that say what they are, a mesh, a C file, and an example that runs."""

import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import onnx
import onnxruntime
import pytest
import trimesh
from c_compiler import library, posed_by
from glb_shapes import posed_by_shapes, read_shapes
from onnxruntime_web import onnxruntime_web
from posed_face import PosedRig, posed_face
from small_artefacts import run_stage, write_artefacts
from untrained_models import MESH, coarse_model

from replicate import __main__ as cli
from replicate.approximation import cnn
from replicate.approximation.rigid import attach
from replicate.base.exceptions import InputError
from replicate.base.paths import ROOT
from replicate.config import CoarseConfig, resolve
from replicate.deployment.model_facts import PATENTS
from replicate.deployment.onnx_model import drawn_poses, largest_distance, posed
from replicate.methods import artefacts, coarse, linear, measurement, neutral_pose, regional, skinned
from replicate.regional import model as regional_model
from replicate.targets import deploy
from replicate.targets.deploy import DeployedMethod, DeploySettings

MODELS = {"coarse": coarse_model(), "regional": posed_face().model}
METHODS = (
    DeployedMethod("coarse", "Coarse", "replicate.methods.coarse:load_model", True),
    DeployedMethod("regional", "Regional (ours)", "replicate.methods.regional:load_model", True),
)
EXAMPLE = ROOT / "examples" / "pose_onnx.py"


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """The folders of all that the target reads, with networks of drawn weights."""
    folder = tmp_path_factory.mktemp("deploy")
    inputs = write_artefacts(folder) | {name: folder / name for name in MODELS}
    for name in MODELS:
        inputs[name].mkdir()
        (inputs[name] / "manifest.json").write_text(json.dumps({"notes": {}}))
    shape = replace(CoarseConfig(), map_size=16, hidden=(32, 128))
    cnn.save(MODELS["coarse"], inputs["coarse"], shape)
    regional_model.save(MODELS["regional"], inputs["regional"])
    for method in (coarse.METHOD, regional.METHOD):
        settings = measurement.measurement_settings(method, resolve("tiny", "quick"))
        inputs, _ = run_stage(measurement.measure, inputs, f"errors_{method.name}", settings, folder)
    return inputs


@pytest.fixture(scope="module")
def deployed(inputs, tmp_path_factory):
    """The folder that the target writes, and what it notes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("replicate.methods.artefacts.load_rig", lambda _: PosedRig())
        settings = DeploySettings("small", "quick", 0, METHODS)
        folders, notes = run_stage(deploy.write, inputs, "deploy", settings, tmp_path_factory.mktemp("out"))
    return folders["deploy"], notes


def wanted(inputs, name, params):
    return attach(MESH, artefacts.load_attachments(inputs), MESH.neutral + MODELS[name].offsets(params))


def test_every_file_is_there_and_said_what_it_is(deployed):
    folder, notes = deployed
    models = [f"deploy_small_{name}{ending}.onnx" for name in MODELS for ending in ("", "_float16")]
    files = {f"deploy_small.{ending}" for ending in ("c", "h", "glb", "json")} | {*models}
    assert {file.name for file in folder.iterdir()} == files == set(notes["files"])
    assert re.fullmatch(r"Coarse, float32; \d\.\d MB, within \de-0[5-7] mm of Python", notes["files"][models[0]])


def test_models_give_pythons_vertices_and_say_names_units_limits_and_errors(deployed, inputs):
    params = drawn_poses(PosedRig.controls, 100, np.random.default_rng(1))
    assert (params > 2).any() and (params < -1).any(), "poses leave the limits"
    for name in MODELS:
        model = onnx.load(deployed[0] / f"deploy_small_{name}.onnx")
        assert largest_distance(posed(model, params), wanted(inputs, name, params)) < 1e-3
        about = {entry.key: entry.value for entry in model.metadata_props}
        control = {"name": "c0", "region": "mouth", "lower": -1.0, "default": 0.0, "upper": 2.0}
        assert json.loads(about["controls"])[0] == control and len(json.loads(about["controls"])) == 12
        assert json.loads(about["segments"]) == ["face", "neck", "tooth"]
        assert json.loads(about["rigid_segments"]) == ["tooth"]
        errors = json.loads(about["held_out_errors"])
        measured = measurement.load_errors(inputs[f"errors_{name}"])
        assert errors["poses"] == 24 and errors["distance_mm"]["mean"] == pytest.approx(
            measured.pose_mm.mean(), rel=1e-4
        )
        assert "not clamped" in about["out_of_range"] and "millimetres" in about["vertices"]
        assert float(about["largest_difference_mm"]) < 1e-3 and "make deploy CHARACTERS=small" in about["made_by"]
        assert f"{errors['distance_mm']['mean']:.2g} mm off" in model.graph.doc_string


def test_what_all_models_share_lies_beside_them_as_json(deployed):
    facts = json.loads((deployed[0] / "deploy_small.json").read_text("utf-8"))
    about = {entry.key: entry.value for entry in onnx.load(deployed[0] / "deploy_small_coarse.onnx").metadata_props}
    assert facts["controls"] == json.loads(about["controls"]) and facts["segments"] == ["face", "neck", "tooth"]
    assert facts["poses"] == about["poses"] == "any number of poses at once, none too"
    assert facts["vertices"] == about["vertices"] and "millimetres" in facts["vertices"]
    assert facts["vertex_count"] == len(MESH.neutral)


def test_the_c_file_gives_pythons_vertices(deployed, inputs, tmp_path):
    params = drawn_poses(PosedRig.controls, 100, np.random.default_rng(2))
    found = posed_by(library(deployed[0] / "deploy_small.c", tmp_path).small_pose, params, len(MESH.neutral))
    assert largest_distance(found, wanted(inputs, "regional", params)) < 1e-3


def test_the_mesh_is_the_neutral_one_in_metres_with_charts(deployed):
    (mesh,) = trimesh.load(deployed[0] / "deploy_small.glb", process=False).geometry.values()
    np.testing.assert_allclose(mesh.vertices, MESH.neutral / 1000, atol=1e-6)
    np.testing.assert_allclose(mesh.visual.uv, MESH.uv, atol=1e-6)
    np.testing.assert_array_equal(mesh.faces, MESH.faces)


SHAPED = DeployedMethod("regional", "Regional (ours)", "replicate.methods.regional:load_model", True)


@pytest.fixture(scope="module")
def shapes(inputs, tmp_path_factory):
    """The folder that the target writes in the form of shapes, and what it notes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("replicate.methods.artefacts.load_rig", lambda _: PosedRig())
        settings = DeploySettings("small", "quick", 0, (SHAPED,))
        folders, notes = run_stage(deploy.write_shapes, inputs, "shapes", settings, tmp_path_factory.mktemp("out"))
    return folders["shapes"], notes


def test_shapes_and_their_weights_give_pythons_vertices_and_say_what_they_are(shapes, inputs):
    folder, notes = shapes
    assert {file.name for file in folder.iterdir()} == {f"deploy_shapes_small_regional.{e}" for e in ("glb", "onnx")}
    assert re.fullmatch(r"24 shapes as .*; \d\.\d MB", notes["files"]["deploy_shapes_small_regional.glb"])
    params = drawn_poses(PosedRig.controls, 100, np.random.default_rng(3))
    found = posed_by_shapes(folder / "deploy_shapes_small_regional", params)
    assert largest_distance(found, wanted(inputs, "regional", params)) < 1e-3
    model = onnx.load(folder / "deploy_shapes_small_regional.onnx")
    about = {entry.key: entry.value for entry in model.metadata_props}
    mesh, _, targets = read_shapes((folder / "deploy_shapes_small_regional.glb").read_bytes())
    assert json.loads(about["shapes"]) == mesh["extras"]["targetNames"] and len(targets) == 24
    assert "morph targets" in about["vertices"] and about["weights"] == "float16, computed in float32"
    assert float(about["largest_difference_mm"]) < 1e-3 and len(json.loads(about["controls"])) == 12
    assert [d.dim_param or d.dim_value for d in model.graph.output[0].type.tensor_type.shape.dim] == ["poses", 24]


def test_the_same_shapes_are_blend_shapes_of_a_usd_where_usd_core_is(inputs, tmp_path, monkeypatch):
    pytest.importorskip("pxr", reason="needs usd-core")
    from pxr import Usd, UsdGeom, UsdSkel

    settings = DeploySettings("small", "quick", 0, (SHAPED,), usd=True)
    monkeypatch.setattr(artefacts, "load_rig", lambda inputs: PosedRig())
    folders, notes = run_stage(deploy.write_shapes, inputs, "shapes", settings, tmp_path)
    stem = folders["shapes"] / "deploy_shapes_small_regional"
    assert "UsdSkel" in notes["files"][f"{stem.name}.usdc"]
    stage = Usd.Stage.Open(f"{stem}.usdc")
    prims = list(stage.Traverse())
    (mesh,) = (UsdGeom.Mesh(prim) for prim in prims if prim.IsA(UsdGeom.Mesh))
    shapes = [UsdSkel.BlendShape(prim) for prim in prims if prim.IsA(UsdSkel.BlendShape)]
    names = list(UsdSkel.BindingAPI(mesh.GetPrim()).GetBlendShapesAttr().Get())
    by_name = dict(zip(names, shapes, strict=True))
    metres = np.asarray(mesh.GetPointsAttr().Get())
    params = drawn_poses(PosedRig.controls, 20, np.random.default_rng(4))
    session = onnxruntime.InferenceSession(f"{stem}.onnx", providers=["CPUExecutionProvider"])
    (weights,) = session.run(["weights"], {"parameters": params})
    posed = np.repeat(metres[None], len(params), axis=0)
    for weight, shape in zip(weights.T, by_name.values(), strict=True):
        rows = shape.GetPointIndicesAttr().Get()
        rows = slice(None) if not rows else np.asarray(rows)
        posed[:, rows] += weight[:, None, None] * np.asarray(shape.GetOffsetsAttr().Get())
    assert largest_distance(posed * 1000, wanted(inputs, "regional", params)) < 1e-3


def test_shapes_that_are_off_are_not_written(inputs, tmp_path, monkeypatch):
    monkeypatch.setattr("replicate.methods.artefacts.load_rig", lambda _: PosedRig())
    still = lambda model, params: np.zeros((len(params), 24), np.float32)  # noqa: E731
    monkeypatch.setattr("replicate.deployment.shapes.found_weights", still)
    with pytest.raises(RuntimeError, match=r"regional as shapes is .* mm off; expected at most 0.0019 mm"):
        run_stage(deploy.write_shapes, inputs, "deploy", DeploySettings("small", "quick", 0, (SHAPED,)), tmp_path)
    assert not list((tmp_path / "deploy").iterdir())


def test_methods_without_shapes_are_left_out_of_many_and_refused_by_name(capsys):
    many = (coarse.METHOD, regional.METHOD, neutral_pose.METHOD, linear.METHOD)
    assert deploy.deployable(many, "all", "shapes") == [regional.METHOD, linear.METHOD]
    sentence = "method 'coarse' has no shapes: expected regional, pca, linear, morph, pca_line or morph_best, or FORM="
    with pytest.raises(InputError, match=sentence):
        deploy.deployable(many, ["coarse,regional"], "shapes")
    assert cli.main(["deploy", "--form", "shapes", "--methods", "coarse"]) == 2
    assert capsys.readouterr().err == f"{sentence}vertices\n"
    assert cli.main(["deploy", "--form", "shape"]) == 2
    assert capsys.readouterr().err == "form: expected vertices or shapes, got 'shape'\n"


def example(folder, *words):
    return subprocess.run([sys.executable, EXAMPLE, *words], cwd=folder, capture_output=True, text=True)


def test_the_example_runs_as_reproducing_shows_it(deployed, inputs, tmp_path):
    assert f"```python\n{EXAMPLE.read_text('utf-8')}```\n" in (ROOT / "REPRODUCING.md").read_text("utf-8")
    title, *lines = filter(None, EXAMPLE.read_text("utf-8").splitlines())
    assert title.startswith('"""') and len(lines) == 24, "REPRODUCING has their number"
    imports = re.findall(r"^import (\w+)", "\n".join(lines), re.MULTILINE)
    assert imports == ["argparse", "difflib", "json", "numpy", "onnxruntime"]
    done = example(tmp_path, deployed[0] / "deploy_small_coarse.onnx", "c0=1.5", "c7=-0.5")
    assert done.returncode == 0, done.stderr
    params = np.zeros((1, 12), np.float32)
    params[0, [0, 7]] = 1.5, -0.5
    np.testing.assert_allclose(np.loadtxt(tmp_path / "vertices.txt"), wanted(inputs, "coarse", params)[0], atol=1e-3)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ((), "the following arguments are required: model"),
        (("nose=1",), "there is no control nose; there are c0, c1, "),
        (("c11_=1",), "there is no control c11_; there are c11, "),
        (("c1",), "argument control=value: invalid setting value: 'c1'"),
        (("c0=1", "c1=abc"), "invalid setting value: 'c1=abc'"),
        (("c1=nan",), "c1: expected a finite number, got nan"),
        (("=1",), "there is no control ; there are c0"),
    ],
)
def test_the_example_refuses_bad_words_in_a_sentence(deployed, tmp_path, words, sentence):
    refused = example(tmp_path, *((deployed[0] / "deploy_small_coarse.onnx", *words) if words else ()))
    assert refused.returncode == 2 and sentence in refused.stderr and "Traceback" not in refused.stderr
    assert not (tmp_path / "vertices.txt").exists()


def test_the_example_for_the_web_poses_the_face_and_refuses_bad_words_in_a_sentence(deployed, inputs, tmp_path):
    (tmp_path / "node_modules").symlink_to(onnxruntime_web().parent)
    shutil.copy(ROOT / "examples" / "pose_web.mjs", tmp_path)
    files = [deployed[0] / "deploy_small.json", deployed[0] / "deploy_small_regional_float16.onnx"]

    def run(*words):
        return subprocess.run(["node", "pose_web.mjs", *words], cwd=tmp_path, capture_output=True, text=True)

    done, params = run(*files, "c0=1.5", "c7=-0.5"), np.zeros((1, 12), np.float32)
    params[0, [0, 7]] = 1.5, -0.5
    np.testing.assert_allclose(np.loadtxt(done.stdout.splitlines()), wanted(inputs, "regional", params)[0], atol=1e-3)
    for words in ((), (*files, "nose=1"), (*files, "c1"), (*files, "c1=abc"), (*files, "c1=")):
        refused = run(*words)
        assert refused.returncode == 2 and not refused.stdout and refused.stderr.count("\n") == 1
        assert "expected a JSON file, a model" in refused.stderr or "expected control=number" in refused.stderr


def test_a_model_that_is_off_is_not_written(inputs, tmp_path, monkeypatch):
    monkeypatch.setattr("replicate.methods.artefacts.load_rig", lambda _: PosedRig())
    still = lambda model, params: np.zeros((len(params), 341, 3))  # noqa: E731
    monkeypatch.setattr("replicate.deployment.onnx_model.posed", still)
    with pytest.raises(RuntimeError, match=r"coarse as ONNX is .* mm off; expected at most 0.001 mm"):
        run_stage(deploy.write, inputs, "deploy", DeploySettings("small", "quick", 0, METHODS), tmp_path)


def test_methods_without_a_model_are_left_out_of_many_and_refused_by_name():
    many = (coarse.METHOD, neutral_pose.METHOD, linear.METHOD)
    assert deploy.deployable(many, "all") == [coarse.METHOD, linear.METHOD]
    with pytest.raises(InputError, match="method 'neutral' has no model to write: it needs more than rig parameters"):
        deploy.deployable(many, ["coarse,neutral"])
    with pytest.raises(InputError, match="method 'lbs16' has no model to write"):
        deploy.deployable(skinned.methods_of(None)[:1], "lbs")


def test_the_note_on_patents_is_that_of_the_readme():
    readme = " ".join((ROOT / "README.md").read_text("utf-8").split())
    for number in ("US 11,348,314 B2 and its family", "FaceBaker is US 11,941,739", "inverse rig is US 12,586,281 B2"):
        assert number in readme and number in PATENTS


def test_models_of_a_face_from_a_file_say_where_its_vertices_are(inputs, tmp_path, monkeypatch):
    rig = PosedRig()
    rig.file_vertices = np.array([2, 0, -1, 1, 0], np.int32)
    monkeypatch.setattr("replicate.methods.artefacts.load_rig", lambda _: rig)
    folders, _ = run_stage(deploy.write, inputs, "deploy", DeploySettings("small", "quick", 0, METHODS), tmp_path)
    about = onnx.load(folders["deploy"] / "deploy_small_coarse.onnx").metadata_props
    assert json.loads({entry.key: entry.value for entry in about}["file_vertices"]) == [2, 0, -1, 1, 0]


def test_models_of_other_faces_say_nothing_of_a_file(deployed):
    about = onnx.load(deployed[0] / "deploy_small_coarse.onnx").metadata_props
    assert "file_vertices" not in {entry.key for entry in about}
