"""The ways to evaluate the same weights: which there are for a model, and how far apart they are."""

import sys

import numpy as np
import pytest
from small_face import pose_offsets
from untrained_models import MESH, MODELS

from replicate.approximation.rigid import attach, find_attachments
from replicate.targets.table3.rows import PEERS_EVERY, turns_of, ways_on
from replicate.timing.backends import fast_rigid_step, largest_difference, onnx_evaluation, other_backends
from replicate.timing.single_poses import FAST, HALF, JAX, ONNX, PLAIN, THREADED, Way, in_table_order, label_of, parted

POSES = np.random.default_rng(0).uniform(-1, 1, (5, 12)).astype(np.float32)
ATTACHMENTS = find_attachments(MESH, MESH.neutral + pose_offsets(MESH, POSES), 0.3, 4)


@pytest.mark.parametrize(
    ("name", "endings"),
    [
        ("refined", (PLAIN, JAX, ONNX, *THREADED, FAST, HALF)),
        ("dense", (JAX, ONNX, *THREADED, FAST, HALF)),
        ("PCA", (ONNX, *THREADED)),
    ],
)
def test_all_backends_of_a_model_give_its_vertices(name, endings, monkeypatch):
    model = MODELS[name]()
    monkeypatch.setattr("replicate.timing.backends.core_count", lambda: 2)
    found = other_backends(model, MESH, ATTACHMENTS)
    assert tuple(found) == endings
    own = attach(MESH, ATTACHMENTS, MESH.neutral + model.offsets(POSES))
    for ending, evaluate in found.items():
        assert largest_difference(evaluate, POSES, own) < (0.02 if ending == HALF else 1e-3), ending
    assert largest_difference(lambda params: MESH.neutral[None], POSES, own) > 0.1


def test_one_core_has_no_evaluation_that_is_divided_among_threads(monkeypatch):
    monkeypatch.setattr("replicate.timing.backends.core_count", lambda: 1)
    assert set(other_backends(MODELS["linear"](), MESH, ATTACHMENTS)).isdisjoint(THREADED)
    names = ("linear_onnx", "linear_onnx_threads", "linear_onnx_spinning", "linear_gpu", "linear_gpu_graph", "rig")
    ways = dict.fromkeys(names, Way(abs))
    assert list(ways_on("one_core", ways)) == ["linear_onnx", "rig"]
    assert list(ways_on("all_cores", ways)) == [*names[:3], "rig"] and list(ways_on("gpu", ways)) == [*names[3:5]]


def test_what_a_fast_evaluation_beats_takes_part_in_fewer_turns():
    turns = {ending: turns_of(ending, ("", PLAIN, FAST, HALF, "_gpu")) for ending in ("", PLAIN, FAST, HALF, "_gpu")}
    assert turns == {"": PEERS_EVERY, PLAIN: PEERS_EVERY, FAST: 1, HALF: 1, "_gpu": 1}
    assert PEERS_EVERY > 1 and turns_of("", ("", ONNX)) == 1, "the only one"


def test_a_model_that_nothing_writes_has_no_onnx_evaluation():
    assert onnx_evaluation(object(), MESH, ATTACHMENTS) is None


def test_without_the_runtime_there_is_no_onnx_evaluation(monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    assert onnx_evaluation(MODELS["dense"](), MESH, ATTACHMENTS) is None


def test_the_fast_rigid_step_is_timed_on_its_own():
    posed = MESH.neutral[None] + pose_offsets(MESH, POSES[:1])
    before = posed.copy()
    np.testing.assert_allclose(
        fast_rigid_step(MESH, ATTACHMENTS, posed)(POSES[:1]), attach(MESH, ATTACHMENTS, posed), atol=1e-3
    )
    np.testing.assert_array_equal(posed, before)


def test_names_say_method_and_backend():
    assert parted("dense_small") == ("dense_small", "") and parted("dense_small_fast") == ("dense_small", FAST)
    names = ["dense_fast", "rigid_step_fast", "coarse", "rig", "dense", "coarse_plain", "rigid_step"]
    ordered = ["rig", "coarse", "coarse_plain", "dense", "dense_fast", "rigid_step", "rigid_step_fast"]
    assert in_table_order(names) == ordered
    assert label_of("dense_half") == "Dense, fast, 16 bits" and parted("dense_onnx_threads") == ("dense", THREADED[0])
    assert parted("refined_gpu_graph") == ("refined", "_gpu_graph") and parted("refined_gpu") == ("refined", "_gpu")
