"""The rigid step in ONNX, in float32: the rotations of `align`, for carriers of any shape and motions of any size."""

import numpy as np
import onnxruntime
import pytest

from replicate.deployment.onnx_graph import OnnxGraph
from replicate.deployment.onnx_rigid import add_rotations, horn_matrix, quaternion_product, rotation_of
from replicate.geometry.alignment import align

SEGMENTS, POSES = 20, 100
SHAPES = {"ball": (10, 8, 5), "plate": (9, 7, 0), "bar": (15, 1, 0.3), "needle": (20, 0.5, 0.1)}


def rotations_of(rest, posed):
    graph = OnnxGraph()
    shape = ["poses", *posed.shape[1:]]
    target = ("turn", ["poses", len(rest), 3, 3])
    model = graph.model(("posed", shape), add_rotations(graph, rest, "posed"), target, {}, "")
    session = onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    return session.run(None, {"posed": posed.astype(np.float32)})[0]


def drawn_rotations(rng, count, size):
    quaternions = np.concatenate([np.ones((count, 1)), size * rng.normal(size=(count, 3))], axis=1)
    return np.array([rotation_of(q / np.linalg.norm(q)) for q in quaternions])


def carriers(spread, size, noise, seed=0):
    """Return carriers at rest (r, c, 3) and in 100 poses (b, r, c, 3), mm, about their means, in float32."""
    rng = np.random.default_rng(seed)
    rest = rng.normal(size=(SEGMENTS, 10, 3)) * spread
    turn = drawn_rotations(rng, POSES * SEGMENTS, size).reshape(POSES, SEGMENTS, 3, 3)
    posed = rest @ turn + noise * np.array(spread) * rng.normal(size=(POSES, *rest.shape))
    return tuple((x - x.mean(-2, keepdims=True)).astype(np.float32) for x in (rest, posed))


def distances(rest, posed, rotation):
    return np.linalg.norm(rest @ rotation - posed, axis=(-2, -1))


@pytest.mark.parametrize("size", [0.1, 0.5, 5], ids="turned by {} or so".format)
@pytest.mark.parametrize("shape", ["ball", "plate", "bar"])
def test_rotations_are_those_of_align(shape, size):
    rest, posed = carriers(SHAPES[shape], size, 0.02)
    true = align(rest, posed)[0]
    np.testing.assert_allclose(rotations_of(rest, posed), true, atol=3e-5)


@pytest.mark.parametrize("noise", [0, 0.1])
@pytest.mark.parametrize("spread", [*SHAPES.values(), (20, 0, 0), (0, 0, 0)], ids=str)
def test_however_thin_the_carriers_are_the_fit_is_as_close_and_the_rotation_one(spread, noise):
    rest, posed = carriers(spread, 0.5, noise)
    found = rotations_of(rest, posed)
    np.testing.assert_allclose(found @ np.swapaxes(found, -1, -2), np.broadcast_to(np.eye(3), found.shape), atol=2e-6)
    assert np.linalg.det(found).min() > 0.999
    best = distances(rest, posed, align(rest, posed)[0])
    assert (distances(rest, posed, found) - best).max() < 2e-4


def test_what_does_not_move_stays_and_a_line_turns_no_more_than_it_must():
    rest, _ = carriers(SHAPES["ball"], 0, 0)
    np.testing.assert_allclose(rotations_of(rest, rest[None]), np.eye(3)[None, None].repeat(SEGMENTS, 1), atol=1e-6)
    line, turned = carriers((20, 0, 0), 0.3, 0)
    np.testing.assert_allclose(rotations_of(line, turned), align(line, turned)[0], atol=0.02)


def test_mirrored_carriers_give_a_rotation_all_the_same():
    rest, _ = carriers(SHAPES["ball"], 0, 0)
    posed = (rest * [1, 1, -1])[None].astype(np.float32)
    np.testing.assert_allclose(rotations_of(rest, posed), align(rest, posed)[0], atol=1e-4)


def test_quaternions_multiply_as_rotations_do_and_horns_matrix_knows_the_best():
    rng = np.random.default_rng(1)
    a, b = (q / np.linalg.norm(q) for q in rng.normal(size=(2, 4)))
    np.testing.assert_allclose(rotation_of(quaternion_product(a, b)), rotation_of(b) @ rotation_of(a), atol=1e-12)
    points = rng.normal(size=(5, 3))
    values, vectors = np.linalg.eigh(horn_matrix(points.T @ (points @ rotation_of(a))))
    np.testing.assert_allclose(abs(vectors[:, -1] @ a), 1, atol=1e-12)
    assert values[-1] == pytest.approx((points**2).sum())
