"""What networks are trained on: Eq. 1 over all that moves, and over what a refinement can change of it."""

import numpy as np
import pytest
import torch
from small_face import small_mesh, small_samples

from replicate.approximation.losses import Supervision


def test_a_refinements_loss_is_that_of_the_whole_mesh_where_nothing_else_differs():
    mesh, rng = small_mesh(), np.random.default_rng(0)
    movable, trainable = np.flatnonzero(mesh.segment < 2), np.arange(20, 60)
    common = (mesh, small_samples(mesh, 20), movable, 5.0, torch.device("cpu"))
    whole, part = Supervision(*common), Supervision(*common, trainable)
    truth = rng.normal(size=(2, len(mesh.neutral), 3)).astype(np.float32)
    found = truth.copy()
    found[:, trainable] += rng.normal(size=(2, len(trainable), 3)).astype(np.float32)
    losses = [
        float(own.loss(*(torch.from_numpy(offsets[:, own.vertices]) for offsets in (found, truth))))
        for own in (whole, part)
    ]
    assert len(part.vertices) < len(whole.vertices) / 2
    assert losses[1] == pytest.approx(losses[0], rel=1e-5) and losses[0] > 0


def test_a_validations_error_is_that_of_the_vertices_that_networks_move():
    mesh, samples = small_mesh(), small_samples(small_mesh(), 20)
    movable = np.flatnonzero(mesh.segment < 2)
    measure = Supervision(mesh, samples, movable, 5.0, torch.device("cpu")).validation()
    off = np.where(mesh.segment < 2, 3.0, 1_000.0).astype(np.float32)[:, None] * np.array([0, 0.6, 0.8], np.float32)
    distance, angle = measure(lambda params: samples.validation_offsets + off)
    assert distance == pytest.approx(3.0, rel=1e-4) and angle < 0.1  # a shift turns no face
