"""JAX evaluates a torch model's weights: the same vertices, for every kind of network that it knows."""

import numpy as np
import pytest
from small_face import pose_offsets
from untrained_models import MESH, MODELS

from replicate.approximation.rigid import attach, find_attachments
from replicate.timing.jax_evaluation import jax_evaluation

POSES = np.random.default_rng(3).uniform(-1, 1, (4, 12)).astype(np.float32)
ATTACHMENTS = find_attachments(MESH, MESH.neutral + pose_offsets(MESH, POSES), 0.3, 4)
FEW = ("regional, all shapes in 16 bits", "regional, a region's shapes in 16 bits")
KNOWN = ("coarse", "refined", "dense", "linear", "coarse beside a line", "regional", *FEW)


@pytest.mark.parametrize("name", KNOWN)
def test_jax_gives_a_models_vertices_with_and_without_the_rigid_step(name):
    model = MODELS[name]()
    free, placed = jax_evaluation(model, MESH, None), jax_evaluation(model, MESH, ATTACHMENTS)
    for pose in POSES[:, None]:
        own = MESH.neutral + model.offsets(pose)
        np.testing.assert_allclose(free(pose), own, atol=1e-3)
        np.testing.assert_allclose(placed(pose), attach(MESH, ATTACHMENTS, own), atol=1e-3)
    assert np.abs(own - MESH.neutral).max() > 0.1 and np.abs(placed(pose) - free(pose)).max() > 0.003


@pytest.mark.parametrize("name", ["PCA", "driven"])
def test_a_model_with_a_network_that_jax_has_no_function_for_has_no_evaluation(name):
    assert jax_evaluation(MODELS[name](), MESH, ATTACHMENTS) is None
