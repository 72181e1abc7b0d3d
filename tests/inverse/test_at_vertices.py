"""An approximation at a few vertices: the same numbers as the whole mesh's, with the derivative in the parameters."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from small_face import M, pose_offsets, small_influence, small_mesh, small_samples, train_small

from replicate.approximation import cnn
from replicate.approximation.conditioning import parameter_scale
from replicate.approximation.model import SegmentedModel
from replicate.approximation.refinement import RefinedModel
from replicate.approximation.segments import coarse_segments, make_segment
from replicate.base.exceptions import InputError
from replicate.baselines import dense
from replicate.baselines.line import line_model
from replicate.config import CoarseConfig, DenseConfig, TrainingConfig
from replicate.inverse.at_vertices import at_vertices
from replicate.regional.basis import loss_metric, principal_basis
from replicate.regional.model import RegionalModel, store
from replicate.regional.networks import fresh_networks

SHORT = TrainingConfig("one_cycle", 20, 8, "uniform")
VERTICES = np.array([310, 37, 120, 270, 340])  # of both charts and, the last one, of the stiff one that nothing moves
PARAMS = np.random.default_rng(3).uniform(-1, 1, (4, M)).astype(np.float32)


def coarse_model(tmp_path, size=32):
    return train_small(cnn, replace(CoarseConfig(), map_size=size, hidden=(32, 128), training=SHORT), tmp_path)[1]


def dense_model(tmp_path):
    return train_small(dense, DenseConfig(hidden=(16, 16), training=SHORT), tmp_path)[1]


def refined_model(tmp_path):
    coarse = coarse_model(tmp_path)
    mesh = small_mesh()
    near = np.flatnonzero((mesh.segment == 0) & (np.abs(mesh.uv - 0.4).max(1) < 0.3))
    segment = make_segment("face_1", near, mesh.uv[near], small_influence(mesh))
    config = replace(CoarseConfig(), map_size=64, hidden=(32, 128))
    network = cnn.make_network(segment, cnn.shape_facts(config))
    return RefinedModel(coarse, SegmentedModel([network], [segment], coarse.scale, [0.5], len(mesh.neutral)))


def linear_model(tmp_path):
    mesh, rng = small_mesh(), np.random.default_rng(1)
    segments = coarse_segments(mesh, {2}, small_influence(mesh))
    weights = [rng.normal(size=(len(s.parameters) + 1, 3 * len(s.vertices))) for s in segments]
    return line_model(segments, weights, parameter_scale(PARAMS), len(mesh.neutral))


def regional_model(tmp_path, fine=2):
    mesh, samples = small_mesh(), small_samples(small_mesh(), 60)
    bases = []
    for k in (0, 1):
        vertices = np.flatnonzero(mesh.segment == k)
        metric = loss_metric(mesh.neutral[vertices], np.zeros((0, 3), int), len(vertices), 1, 0.0)
        basis = store(principal_basis(vertices, samples.offsets(np.arange(60))[:, vertices], metric, 6), fine)
        if k == 1:  # it has vertices of the first region too
            basis.vertices[::4] = torch.from_numpy(np.flatnonzero(mesh.segment == 0)[: len(vertices[::4])])
            basis.weights[::2] = 0.4
        bases.append(basis)
    rng, seen = np.random.default_rng(2), [np.arange(0, M, 2), np.arange(1, M)]
    network = fresh_networks(seen, (8, 8), [len(basis.steps) for basis in bases], gated=True, line=True)
    for part, own, basis in zip(network.networks, seen, bases, strict=True):
        part.start(rng.normal(size=(len(own) + 1, len(basis.steps))), torch.Generator().manual_seed(0))
        part.limit(rng.uniform(-0.3, 0.3, (9, len(own))))
    return RegionalModel(network, bases, np.ones(M, np.float32), 3.0, len(mesh.neutral))


MODELS = {
    "coarse": coarse_model,
    "refined": refined_model,
    "dense": dense_model,
    "linear": linear_model,
    "regional": regional_model,
    "regional, all shapes in 16 bits": lambda tmp_path: regional_model(tmp_path, 6),
}


@pytest.mark.parametrize("name", MODELS)
def test_it_gives_what_the_whole_model_gives(name, tmp_path):
    model = MODELS[name](tmp_path)
    whole = model.offsets(PARAMS)[:, VERTICES]
    points = at_vertices(model, VERTICES)(torch.from_numpy(PARAMS))
    assert points.shape == (4, 5, 3) and np.abs(whole).max() > 0.01
    np.testing.assert_allclose(points.detach().numpy(), whole, atol=1e-4)


@pytest.mark.parametrize("name", MODELS)
def test_its_derivative_is_that_of_finite_differences(name, tmp_path):
    points = at_vertices(MODELS[name](tmp_path), VERTICES)
    params = torch.from_numpy(PARAMS[:1]).requires_grad_(True)
    weights = torch.from_numpy(np.random.default_rng(0).normal(size=(1, 5, 3)).astype(np.float32))
    (points(params) * weights).sum().backward()
    step = 2e-3
    moved = torch.from_numpy(PARAMS[:1]) + torch.cat([torch.eye(M), -torch.eye(M)]) * step
    with torch.no_grad():
        values = (points(moved) * weights).sum((1, 2))
    differences = (values[:M] - values[M:]) / (2 * step)
    scale = float(differences.abs().max())
    assert float((params.grad[0] - differences).abs().max()) < 0.05 * scale


@pytest.mark.parametrize("name", MODELS)
def test_its_weights_are_frozen_and_those_of_the_model_are_not_touched(name, tmp_path):
    model = MODELS[name](tmp_path)
    before = model.offsets(PARAMS)
    points = at_vertices(model, VERTICES)
    assert not any(weight.requires_grad for weight in points.parameters())
    np.testing.assert_array_equal(model.offsets(PARAMS), before)


def test_a_model_from_outside_brings_its_own_function():
    class Outside:
        def at_vertices(self, vertices):
            return lambda params: params[:, :1, None].expand(-1, len(vertices), 3)

    assert at_vertices(Outside(), VERTICES)(torch.ones(2, M)).shape == (2, 5, 3)
    with pytest.raises(InputError, match="object can't be differentiated"):
        at_vertices(object(), VERTICES)


def test_the_stand_in_moves_the_vertices_of_these_tests():
    moved = np.abs(pose_offsets(small_mesh(), PARAMS)).max(axis=(0, 2))[VERTICES]
    assert (moved[:4] > 0.05).all() and moved[4] == 0


def test_networks_of_regions_without_such_vertices_are_left_out(tmp_path):
    model = regional_model(tmp_path)
    own = model.bases[1].vertices.numpy()[1:4]
    points = at_vertices(model, own)
    assert len(points.network.networks) == 1
    found = points(torch.from_numpy(PARAMS)).numpy()
    np.testing.assert_allclose(found, model.offsets(PARAMS)[:, own], atol=1e-5)
