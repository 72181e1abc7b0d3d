"""Models evaluated by torch on a device: the function is the model's own, and on a GPU both ways give its vertices."""

import numpy as np
import pytest
import torch
from small_face import pose_offsets
from untrained_models import MESH, MODELS

from replicate.approximation.rigid import attach, find_attachments
from replicate.timing.backends import gpu_backends
from replicate.timing.gpu_evaluation import gpu_evaluation, offsets_on
from replicate.timing.single_poses import GPU, GRAPH

POSES = np.random.default_rng(0).uniform(-1, 1, (5, 12)).astype(np.float32)
ATTACHMENTS = find_attachments(MESH, MESH.neutral + pose_offsets(MESH, POSES), 0.3, 4)
needs_gpu = pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU")


def own_vertices(model, params):
    return attach(MESH, ATTACHMENTS, MESH.neutral + model.offsets(params))


@pytest.mark.parametrize("name", MODELS)
def test_every_model_gives_its_vertices_as_a_function_of_tensors(name):
    model = MODELS[name]()
    evaluate = gpu_evaluation(model, MESH, ATTACHMENTS, "cpu")
    np.testing.assert_allclose(evaluate(POSES), own_vertices(model, POSES), atol=1e-3)
    assert np.abs(evaluate(POSES) - MESH.neutral).max() > 0.1


def test_a_model_unknown_to_torch_has_no_evaluation():
    assert offsets_on(object(), "cpu") is None and gpu_evaluation(object(), MESH, ATTACHMENTS, "cpu") is None


def test_without_a_gpu_nothing_is_evaluated_there(monkeypatch):
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    assert gpu_backends(MODELS["dense"](), MESH, ATTACHMENTS) == {}


@needs_gpu
@pytest.mark.parametrize("name", MODELS)
def test_a_gpu_gives_every_models_vertices(name):
    model = MODELS[name]()
    found = gpu_backends(model, MESH, ATTACHMENTS)
    assert tuple(found) == (GPU, GRAPH)
    for evaluate in found.values():
        moved = np.concatenate([evaluate(pose[None]) for pose in POSES])
        np.testing.assert_allclose(moved, own_vertices(model, POSES), atol=1e-3)
