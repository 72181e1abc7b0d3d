"""Models as shapes: weights by onnxruntime times the morph targets of a GLB are Python's vertices, rigid ones too."""

from functools import cache, partial
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
import trimesh
from glb_shapes import read_shapes
from posed_face import PosedRig, posed_face, regional_model
from small_face import M
from untrained_models import MESH, MODELS, SCALE

from replicate.approximation.model import SegmentedModel
from replicate.approximation.rigid import Attachments, attach
from replicate.approximation.segments import Segment
from replicate.base.exceptions import InputError
from replicate.baselines.line import line_model
from replicate.deployment.shapes import REST, add_targets, found_weights, shaped_face, weights_model
from replicate.export.files import glb, posed_parts
from replicate.methods import pca
from replicate.regional.model import RegionalModel

ATTACHMENTS, CONTROLS = posed_face().attachments, PosedRig.controls
TOOTH = np.flatnonzero(MESH.segment == 2)
POSES = np.random.default_rng(0).uniform(-3, 3, (100, M)).astype(np.float32)  # the limits are −1 and 2
WITHIN = np.random.default_rng(1).uniform(-1, 2, (100, M)).astype(np.float32)
REST_POSE = np.zeros((1, M), np.float32)
UNITY = Path(__file__).with_name("unity_operators.txt")
KINDS = [name for name in MODELS if name.split()[0].strip(",") in ("regional", "morph", "linear", "PCA")]
NETWORKS = [name for name in KINDS if name != "linear"]


@cache
def shaped(kind):
    return shaped_face(MODELS[kind](), MESH, ATTACHMENTS, CONTROLS)


@cache
def weights_of(kind):
    return weights_model(shaped(kind))


def wanted(model, params, attachments=ATTACHMENTS):
    with torch.no_grad():
        vertices = MESH.neutral + model.offsets(params)
    return attach(MESH, attachments, vertices) if attachments else vertices


def furthest(one, other):
    return float(np.linalg.norm(one - other, axis=-1).max())


def written(face):
    return glb([posed_parts(PosedRig(), PosedRig.default)[0]], {}, partial(add_targets, face))


@pytest.mark.parametrize("kind", KINDS)
def test_weights_times_the_targets_of_the_file_are_pythons_vertices_beyond_the_limits_too(kind):
    face = shaped(kind)
    mesh, neutral, targets = read_shapes(written(face))
    weights = found_weights(weights_of(kind), POSES)
    found = 1000 * (neutral + np.tensordot(weights, targets, 1))
    expected = wanted(MODELS[kind](), POSES)
    assert weights.dtype == np.float32 and furthest(found, expected) < 1e-3
    assert furthest(expected, MESH.neutral) > 1, "nothing moves, and the test says nothing"
    assert furthest(expected[:, TOOTH], MESH.neutral[TOOTH]) > 1, "the rigid segment stays, and the test says less"
    assert mesh["extras"]["targetNames"] == face.names and len(set(face.names)) == len(targets)
    at_rest = 1000 * (neutral + np.tensordot(np.array(mesh["weights"], np.float32), targets, 1))
    assert furthest(at_rest, wanted(MODELS[kind](), REST_POSE)) < 1e-3


@pytest.mark.parametrize("kind", KINDS)
def test_python_has_the_same_weights_and_the_same_vertices(kind):
    face, model = shaped(kind), MODELS[kind]()
    assert furthest(face.posed(face.weights(POSES)), wanted(model, POSES)) < 1e-3
    networks = len(face.shapes) - 12  # a line of carriers leaves a rotation's last digits open
    found = found_weights(weights_of(kind), WITHIN)
    np.testing.assert_allclose(found[:, :networks], face.weights(WITHIN)[:, :networks], atol=1e-4)
    assert furthest(face.posed(found), face.posed(face.weights(WITHIN))) < 1e-3


@pytest.mark.parametrize("kind", KINDS)
def test_every_operator_and_the_opset_are_among_those_that_unity_imports(kind):
    lines = [line.split() for line in UNITY.read_text().splitlines() if not line.startswith("#")]
    (_, first, last), *names = lines
    model = weights_of(kind)
    (opset,) = model.opset_import
    assert opset.domain == "" and int(first) <= opset.version <= int(last)
    assert {node.op_type for node in model.graph.node} <= {name for line in names for name in line}


@pytest.mark.parametrize("kind", KINDS)
def test_no_poses_give_no_weights_and_a_pose_does_not_depend_on_its_neighbours(kind):
    face, model = shaped(kind), weights_of(kind)
    assert found_weights(model, POSES[:0]).shape == (0, len(face.shapes))
    assert furthest(face.posed(found_weights(model, WITHIN[3:4])), face.posed(found_weights(model, WITHIN)[3:4])) < 1e-4


@pytest.mark.parametrize("kind", NETWORKS)
def test_weights_are_zero_at_rest_and_about_one_at_most_within_the_limits(kind):
    face = shaped(kind)
    networks = [k for k, name in enumerate(face.names) if not name.startswith(("tooth", REST))]
    np.testing.assert_allclose(face.at_rest[networks], 0, atol=1e-6)
    largest = np.abs(face.weights(WITHIN)[:, networks]).max(0)
    assert largest.max() < 10 and np.median(largest) > 0.5
    assert face.names.count(REST) == 1 and face.at_rest[face.names.index(REST)] == 1


def test_a_line_has_a_shape_for_each_control_whose_weight_is_the_controls_distance_from_its_default():
    vertices = np.arange(len(MESH.neutral), dtype=np.int32)
    segment = MODELS["products"]().segments[0]
    weights = np.random.default_rng(2).normal(size=(M + 1, 3 * len(vertices))).astype(np.float32)
    model = line_model([segment], [weights], SCALE, len(vertices))
    face = shaped_face(model, MESH, None, CONTROLS)
    assert face.names == [*(control.name for control in CONTROLS), REST]
    found = found_weights(weights_model(face), POSES)
    np.testing.assert_array_equal(found, np.column_stack([POSES, np.ones(len(POSES))]))
    np.testing.assert_allclose(face.shapes[0].offsets, weights[0].reshape(-1, 3) / SCALE[0], rtol=1e-6)


def test_a_rigid_segment_is_moved_by_twelve_shapes_and_by_no_other():
    face = shaped("regional")
    movers = [shape.name for shape in face.shapes if np.isin(TOOTH, shape.vertices).any()]
    turns = [f"tooth_turn_{i}{j}" for i in "xyz" for j in "xyz"]
    assert movers == [*turns, *(f"tooth_shift_{j}" for j in "xyz")] == face.names[-12:]


def test_what_a_network_says_of_rigid_segments_is_left_out():
    vertices = np.arange(len(MESH.neutral), dtype=np.int32)
    torch.manual_seed(4)
    basis, mean = torch.randn(7, 3 * len(vertices)), torch.randn(3 * len(vertices))
    whole = Segment("mesh", vertices, np.zeros((len(vertices), 2), np.float32), np.arange(M, dtype=np.int32))
    model = SegmentedModel([pca.make_network(M, basis, mean, (16,), 0.2)], [whole], SCALE, [1.0], len(vertices))
    face = shaped_face(model, MESH, ATTACHMENTS, CONTROLS)
    assert furthest(face.posed(found_weights(weights_model(face), POSES)), wanted(model, POSES)) < 1e-3
    assert sum(np.isin(TOOTH, shape.vertices).any() for shape in face.shapes) == 12


def test_shapes_of_a_region_move_its_vertices_alone_and_come_in_its_order():
    face, model = shaped("regional"), regional_model()
    for shape in face.shapes[: len(face.names) - 13]:
        basis = model.bases[int(shape.name.split("_")[1])]
        np.testing.assert_array_equal(shape.vertices, np.sort(basis.vertices.numpy()))


def test_a_model_that_is_exact_at_rest_has_no_shape_of_rest():
    model = regional_model()
    numbers, rest = (model.scale.numpy(), model.length, model.vertex_count), np.zeros(M)
    bases = RegionalModel(model.network, model.bases, *numbers, rest).bases  # as they are stored
    exact = RegionalModel(model.network, bases, *numbers, rest)
    found = shaped_face(exact, MESH, ATTACHMENTS, CONTROLS)
    assert REST not in found.names and np.abs(found.at_rest).max() < 1e-3
    assert furthest(found.posed(found_weights(weights_model(found), POSES)), wanted(exact, POSES)) < 1e-3


def test_without_the_rigid_step_and_without_rigid_segments_nothing_is_turned():
    none = Attachments(*(array[:0] for array in vars(ATTACHMENTS).values()))
    for attachments in (None, none):
        face = shaped_face(MODELS["PCA"](), MESH, attachments, CONTROLS)
        assert not any("turn" in name for name in face.names)
        assert (
            furthest(face.posed(found_weights(weights_model(face), POSES)), wanted(MODELS["PCA"](), POSES, None)) < 1e-3
        )


def test_weights_of_16_bits_stay_so_and_others_stay_whole():
    ours, whole = shaped("regional"), shaped("morph")
    assert ours.has_halves and not whole.has_halves and not shaped("linear").has_halves
    kinds = {tensor.data_type for tensor in weights_model(ours).graph.initializer}
    assert onnx.TensorProto.FLOAT16 in kinds
    assert onnx.TensorProto.FLOAT16 not in {tensor.data_type for tensor in weights_model(whole).graph.initializer}


def test_trimesh_reads_the_head_with_the_segment_of_each_vertex():
    data = written(shaped("regional"))
    (mesh,) = trimesh.load(trimesh.util.wrap_as_stream(data), file_type="glb", process=False).geometry.values()
    np.testing.assert_allclose(mesh.vertices, MESH.neutral / 1000, atol=1e-6)
    np.testing.assert_array_equal(mesh.faces, MESH.faces)
    np.testing.assert_array_equal(np.ravel(mesh.vertex_attributes["_SEGMENT"]), MESH.segment)
    assert read_shapes(data)[0]["extras"]["segmentNames"] == list(MESH.segment_names)


def test_a_shape_that_moves_nothing_is_a_target_of_zeros():
    model = MODELS["linear"]()
    for network in model.networks:
        network.weight[2] = 0
    face = shaped_face(model, MESH, ATTACHMENTS, CONTROLS)
    _, _, targets = read_shapes(written(face))
    assert len(targets) == len(face.shapes) and not targets[2].any()


@pytest.mark.parametrize("kind", ["coarse", "refined", "dense", "driven"])
def test_models_without_shapes_are_refused_in_a_sentence(kind):
    with pytest.raises(InputError, match="has no shapes"):
        shaped(kind)
