"""An approximation as one ONNX model: runtimes, that of the web too, give Python's vertices, rigid ones as well."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from onnx.reference import ReferenceEvaluator
from onnxruntime_web import onnxruntime_web
from posed_face import posed_face
from small_face import M
from torch import nn
from untrained_models import MESH, MODELS, SCALE, SEGMENTS, coarse_model, linear_model

from replicate.approximation.model import SegmentedModel
from replicate.approximation.rigid import attach
from replicate.base.exceptions import InputError
from replicate.base.paths import ROOT
from replicate.deployment.onnx_graph import IR_VERSION, OPSET
from replicate.deployment.onnx_model import onnx_model

WEB_PROGRAM = Path(__file__).with_name("posed_on_web.mjs")
UNITY = Path(__file__).with_name("unity_operators.txt")
ATTACHMENTS = posed_face().attachments
POSES = np.random.default_rng(0).uniform(-3, 3, (100, M)).astype(np.float32)  # the limits are −1 and 2


def run(model, params):
    session = onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    return session.run(None, {"parameters": params})[0]


def wanted(model, attachments=ATTACHMENTS):
    with torch.no_grad():
        vertices = MESH.neutral + model.offsets(POSES)
    return attach(MESH, attachments, vertices) if attachments else vertices


def furthest(one, other):
    return float(np.linalg.norm(one - other, axis=-1).max())


@pytest.mark.parametrize("kind", MODELS)
def test_onnxruntime_gives_pythons_vertices_beyond_the_limits_too(kind):
    model = MODELS[kind]()
    written = onnx_model(model, MESH, ATTACHMENTS)
    found = run(written, POSES)
    assert found.dtype == np.float32 and furthest(found, wanted(model)) < 1e-3
    assert furthest(found, MESH.neutral) > 1, "nothing moves, and the test says nothing"
    assert furthest(run(written, POSES[3:4]), found[3:4]) < 1e-4, "a pose depends on its neighbours"


@pytest.mark.parametrize("kind", MODELS)
def test_every_operator_and_the_opset_are_among_those_that_unity_imports(kind):
    lines = [line.split() for line in UNITY.read_text().splitlines() if not line.startswith("#")]
    (_, first, last), *names = lines
    for half in (False, True):
        written = onnx_model(MODELS[kind](), MESH, ATTACHMENTS, half)
        (opset,) = written.opset_import
        assert opset.domain == "" and int(first) <= opset.version <= int(last)
        assert {node.op_type for node in written.graph.node} <= {name for line in names for name in line}
        onnx.checker.check_model(written, full_check=True)


def test_the_page_on_engines_names_every_operator_and_only_these():
    page = (ROOT / "ENGINES.md").read_text("utf-8")
    listed = re.search(r"All models together use ([\w\s]+)\.", page)[1].split()
    models = [onnx_model(make(), MESH, ATTACHMENTS, half=True) for make in MODELS.values()]
    assert sorted({node.op_type for model in models for node in model.graph.node}) == listed
    assert f"Opset {OPSET}, IR {IR_VERSION}" in page


@pytest.fixture
def on_the_web(tmp_path):
    """Return a function (model, params) → vertices, by onnxruntime-web in Node.js."""
    package, node = onnxruntime_web(), shutil.which("node")

    def posed(model, params):
        (tmp_path / "model.onnx").write_bytes(model.SerializeToString())
        (tmp_path / "params").write_bytes(params.tobytes())
        command = [node, WEB_PROGRAM, package, tmp_path, *map(str, params.shape)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, done.stderr[-2000:]
        return np.fromfile(tmp_path / "vertices", np.float32).reshape(json.loads(done.stdout))

    return posed


@pytest.mark.parametrize("kind", ["coarse", "refined", "linear", "driven", "regional"])
def test_onnxruntime_web_gives_pythons_vertices_and_none_where_there_are_no_poses(kind, on_the_web):
    model = MODELS[kind]()
    written = onnx_model(model, MESH, ATTACHMENTS, half=kind == "regional")
    assert furthest(on_the_web(written, POSES), wanted(model)) < 1e-3
    assert on_the_web(written, POSES[:0]).shape == (0, len(MESH.neutral), 3)


@pytest.mark.parametrize("kind", MODELS)
def test_no_constant_is_the_left_factor_of_a_product_of_poses(kind):
    graph = onnx_model(MODELS[kind](), MESH, ATTACHMENTS).graph
    constants = {weight.name for weight in graph.initializer}
    shapes = {weight.name: [*weight.dims] for weight in graph.initializer}
    products = [node for node in graph.node if node.op_type == "MatMul"]
    assert products and not [node.name for node in products if node.input[0] in constants]
    assert all(len(shapes[name]) == 2 for node in products for name in node.input if name in constants)


@pytest.mark.parametrize("kind", MODELS)
def test_no_poses_give_no_vertices(kind):
    for attachments in (ATTACHMENTS, None):
        found = run(onnx_model(MODELS[kind](), MESH, attachments), POSES[:0])
        assert found.shape == (0, len(MESH.neutral), 3) and found.dtype == np.float32


@pytest.mark.parametrize("kind", MODELS)
def test_weights_of_16_bits_cost_some_thousandths_of_the_movement_at_most(kind):
    model = MODELS[kind]()
    whole, half = (onnx_model(model, MESH, ATTACHMENTS, half) for half in (False, True))
    reach = np.linalg.norm(model.offsets(POSES), axis=-1).max()
    assert half.ByteSize() < whole.ByteSize()
    assert furthest(run(half, POSES), wanted(model)) < 5e-3 * reach


@pytest.mark.parametrize("kind", ["coarse", "regional"])
def test_the_reference_runtime_gives_the_same_so_that_nothing_hangs_on_onnxruntime(kind):
    model = MODELS[kind]()
    (found,) = ReferenceEvaluator(onnx_model(model, MESH, ATTACHMENTS, True)).run(None, {"parameters": POSES[:2]})
    np.testing.assert_allclose(found, run(onnx_model(model, MESH, ATTACHMENTS, True), POSES[:2]), atol=1e-3)


def test_our_method_loses_nothing_in_16_bits():
    model = MODELS["regional"]()
    whole, half = (run(onnx_model(model, MESH, ATTACHMENTS, half), POSES) for half in (False, True))
    np.testing.assert_allclose(half, whole, atol=1e-4)


def test_without_the_rigid_step_rigid_segments_stay():
    model = linear_model()
    found = run(onnx_model(model, MESH, None), POSES)
    assert furthest(found, wanted(model, None)) < 1e-3
    rigid = MESH.segment == 2
    np.testing.assert_array_equal(found[:, rigid], np.broadcast_to(MESH.neutral[rigid], (100, 4, 3)))


def test_a_model_says_what_it_is():
    model = onnx_model(linear_model(), MESH, ATTACHMENTS, about={"units": "mm"}, words="A straight line.")
    assert {entry.key: entry.value for entry in model.metadata_props} == {"units": "mm"}
    assert model.graph.doc_string == "A straight line."
    (source,), (target,) = model.graph.input, model.graph.output
    assert [d.dim_param or d.dim_value for d in source.type.tensor_type.shape.dim] == ["poses", M]
    assert [d.dim_param or d.dim_value for d in target.type.tensor_type.shape.dim] == ["poses", len(MESH.neutral), 3]
    assert source.type.tensor_type.elem_type == target.type.tensor_type.elem_type == onnx.TensorProto.FLOAT


def test_a_wrong_shape_is_refused_by_the_runtime_in_words():
    written = onnx_model(coarse_model(), MESH, ATTACHMENTS)
    with pytest.raises(Exception, match=f"(?s)invalid dimensions.*parameters.*Got: 5 Expected: {M}"):
        run(written, np.zeros((2, 5), np.float32))
    with pytest.raises(Exception, match="Invalid rank for input: parameters Got: 1 Expected: 2"):
        run(written, np.zeros(M, np.float32))


class Arctangent(nn.Module):
    def forward(self, params):
        return params.atan()[:, :, None].expand(-1, -1, 3)


class FirstOnly(nn.Module):
    def forward(self, params):
        return params[:1]


class Doubled(nn.Module):
    def forward(self, params):
        return torch.add(params, params, alpha=2)


class RoundedDown(nn.Module):
    def forward(self, params):
        return torch.div(params, 2, rounding_mode="floor")


class SumOfAll(nn.Module):
    def forward(self, params):
        return params - params.sum()


@pytest.mark.parametrize(
    ("network", "words"),
    [
        (Arctangent, "atan"),
        (FirstOnly, "getitem, but to add dimensions"),
        (Doubled, "add with alpha"),
        (RoundedDown, "div with rounding_mode"),
        (SumOfAll, "sum with such arguments"),
    ],
)
def test_what_has_no_operator_is_refused_in_a_sentence(network, words):
    model = SegmentedModel([network()], SEGMENTS[:1], SCALE, [1.0], len(MESH.neutral))
    with pytest.raises(InputError, match=f"{network.__name__} calls torch's {words}, which has no ONNX operator here"):
        onnx_model(model, MESH, ATTACHMENTS)


class Turned(nn.Module):
    """A layer whose output is `turn`ed into offsets: (b, 3k) → (b, k, 3)."""

    def __init__(self, turn, segment):
        super().__init__()
        torch.manual_seed(5)
        self.turn, self.count = turn, len(segment.vertices)
        self.layer = nn.Sequential(nn.Linear(len(segment.parameters), 3 * self.count), nn.ReLU())

    def forward(self, params):
        return self.turn(self.layer(params), self.count)


TURNS = {
    "unflattened from the end": lambda x, k: x.unflatten(-1, (k, 3)),
    "unflattened before the end": lambda x, k: x.unflatten(1, (3 * k, 1)).unflatten(-2, (k, 3)).sum(-1),
    "flattened from the end": lambda x, k: x.unflatten(1, (k, 3)).flatten(-2).unflatten(1, (-1, 3)),
    "transposed": lambda x, k: x.unflatten(1, (3, k)).transpose(-1, 1),
    "flattened with the poses": lambda x, k: x.unflatten(1, (k, 3)).flatten(0, 1).unflatten(0, (-1, k)),
    "after a constant matrix": lambda x, k: torch.linspace(0, 1, k * k).reshape(k, k) @ x.unflatten(1, (k, 3)),
    "after a constant matrix each": lambda x, k: (torch.ones(k, 1, 1) @ x.unflatten(1, (k, 1, 3))).squeeze(2),
    "beside sums that keep their dimension": lambda x, k: (x - x.sum(-1, keepdim=True) / (3 * k)).unflatten(1, (k, 3)),
    "beside sums over two dimensions": lambda x, k: x.unflatten(1, (k, 3)) / x.unflatten(1, (k, 3)).sum((1, 2), True),
}


@pytest.mark.parametrize("turn", TURNS)
def test_dimensions_that_count_from_the_end_and_sums_give_what_torch_gives(turn):
    model = SegmentedModel([Turned(TURNS[turn], SEGMENTS[0])], SEGMENTS[:1], SCALE, [1.0], len(MESH.neutral))
    written = onnx_model(model, MESH, None)
    found = run(written, POSES)
    assert run(written, POSES[:0]).shape == (0, len(MESH.neutral), 3)
    assert furthest(found, wanted(model, None)) < 1e-4 and furthest(found, MESH.neutral) > 1e-2


def test_what_is_no_model_is_refused_in_a_sentence():
    with pytest.raises(InputError, match="PosedFace can't be written as ONNX: expected a SegmentedModel, "):
        onnx_model(posed_face(), MESH, ATTACHMENTS)
