"""The fast evaluation of every kind of model against its own prediction with the clear rigid step."""

import numpy as np
import pytest
import torch
from small_face import M, pose_offsets, small_influence, small_mesh

from replicate.approximation import cnn
from replicate.approximation.model import SegmentedModel
from replicate.approximation.refinement import RefinedModel
from replicate.approximation.rigid import attach, find_attachments
from replicate.approximation.segments import coarse_segments, make_segment
from replicate.baselines import dense
from replicate.baselines.line import Line
from replicate.inference.fast_evaluation import fast_evaluation
from replicate.regional.basis import RegionalBasis
from replicate.regional.model import RegionalModel, halve, store
from replicate.regional.networks import fresh_networks

MESH, RNG = small_mesh(), np.random.default_rng(0)
SCALE = RNG.uniform(0.5, 2, M).astype(np.float32)
POSES = RNG.uniform(-1, 1, (40, M)).astype(np.float32) * (RNG.uniform(size=(40, M)) < 0.7)  # some controls rest
ATTACHMENTS = find_attachments(MESH, MESH.neutral + pose_offsets(MESH, POSES), 0.3, 4)
SEGMENTS = coarse_segments(MESH, {2}, small_influence(MESH))
MAPS = {"map_size": 32, "channels": 16, "hidden": [32, 512], "leaky_slope": 0.2}


def of_networks(make, segments, facts, lengths=(8.0, 3.0)):
    torch.manual_seed(0)
    networks = [make(segment, facts) for segment in segments]
    return SegmentedModel(networks, segments, SCALE, lengths, len(MESH.neutral))


def coarse():
    return of_networks(cnn.make_network, SEGMENTS, MAPS)


def refined():
    parts = (np.arange(20, 90), np.arange(260, 300))
    squares = [make_segment(f"s{k}", v, MESH.uv[v] * 0.9, small_influence(MESH)) for k, v in enumerate(parts)]
    return RefinedModel(coarse(), of_networks(cnn.make_network, squares, MAPS | {"map_size": 64}))


def dense_networks():
    return of_networks(dense.make_network, SEGMENTS, {"hidden": [24, 40], "leaky_slope": 0.2})


def morphs():
    return of_networks(dense.make_network, SEGMENTS, {"hidden": [24, 40], "leaky_slope": 0.2, "shapes": 9})


def lines():
    model = of_networks(lambda segment, _: Line(len(segment.parameters), len(segment.vertices)), SEGMENTS, {})
    for network in model.networks:
        torch.nn.init.normal_(network.weight)
        torch.nn.init.normal_(network.bias)
    return model


def regional(gated=True, line=True, apart=True, fine=(5, 5)):
    """fine: how many of each region's 13 shapes are stored in 16 bits."""
    bases = []
    for segment, first in zip(SEGMENTS, fine, strict=True):
        shapes = RNG.normal(size=(14, len(segment.vertices), 3)).astype(np.float32)
        basis = store(RegionalBasis(segment.vertices, shapes[0], shapes[1:]), first)
        basis.vertices[:7] = torch.from_numpy(SEGMENTS[0].vertices[:7])  # both regions have them
        basis.weights[:7] = torch.linspace(0.2, 0.8, 7)
        bases.append(basis)
    torch.manual_seed(1)
    seen = [np.arange(0, M, 2), np.arange(1, M)] if apart else [np.arange(M)]
    network = fresh_networks(seen, (24, 20), [13, 13], gated, line)
    for part, own in zip(network.networks, seen, strict=True):
        part.bound(np.array([[-0.5], [0.25]]) * np.ones(len(own)))
    halve(network)
    for part, own in zip(network.networks, seen, strict=True):
        part.limit(RNG.uniform(-0.2, 0.1, (9, len(own))))
    return RegionalModel(network, bases, SCALE, 2.0, len(MESH.neutral))


MODELS = {
    "coarse": coarse,
    "refined": refined,
    "dense": dense_networks,
    "morphs": morphs,
    "linear": lines,
    "regional": regional,
    "regional without gates and line": lambda: regional(False, False),
    "regional with one network": lambda: regional(apart=False),
    "regional with all shapes in 16 bits": lambda: regional(fine=(13, 13)),  # as of regions of few shapes
    "regional with a region's shapes in 16 bits": lambda: regional(fine=(13, 5)),
    "regional with all shapes in 8 bits": lambda: regional(fine=(0, 0)),
}


@pytest.mark.parametrize("name", MODELS)
def test_every_pose_is_the_models_own(name):
    model = MODELS[name]()
    evaluate = fast_evaluation(model, MESH, ATTACHMENTS)
    truth = attach(MESH, ATTACHMENTS, MESH.neutral + model.offsets(POSES))
    assert np.abs(truth - MESH.neutral).max() > 0.5
    for params, expected in zip(POSES, truth, strict=True):
        posed = evaluate(params[None])
        assert posed.shape == (1, *MESH.neutral.shape) and posed.dtype == np.float32
        np.testing.assert_allclose(posed[0], expected, atol=1e-3, err_msg=name)


@pytest.mark.parametrize("name", ["coarse", "refined", "dense", "morphs", "linear"])
def test_halves_are_off_by_what_sixteen_bits_round(name):
    model = MODELS[name]()
    evaluate = fast_evaluation(model, MESH, ATTACHMENTS, halves=True)
    truth = attach(MESH, ATTACHMENTS, MESH.neutral + model.offsets(POSES))
    error = max(np.abs(evaluate(params[None])[0] - own).max() for params, own in zip(POSES, truth, strict=True))
    assert 1e-6 < error < 2e-3 * np.abs(truth - MESH.neutral).max()


def test_a_pose_keeps_nothing_of_the_one_before():
    evaluate = fast_evaluation(refined(), MESH, ATTACHMENTS)
    first = evaluate(POSES[:1])
    kept = first.copy()
    assert np.abs(evaluate(POSES[1:2]) - kept).max() > 1e-2
    np.testing.assert_array_equal(first, kept)
    np.testing.assert_array_equal(evaluate(POSES[:1]), kept)


def test_parameters_of_another_type_are_taken_as_float32():
    evaluate = fast_evaluation(dense_networks(), MESH, ATTACHMENTS)
    np.testing.assert_array_equal(evaluate(POSES[:1].astype(np.float64)), evaluate(POSES[:1]))


def test_a_model_without_a_fast_evaluation_gets_none():
    assert fast_evaluation(object(), MESH, ATTACHMENTS) is None
    for other in ({"channels": 8}, {"hidden": [32, 2048]}):
        assert fast_evaluation(of_networks(cnn.make_network, SEGMENTS, MAPS | other), MESH, ATTACHMENTS) is None
    wide = of_networks(lambda s, f: torch.nn.Linear(len(s.parameters), 3 * len(s.vertices)), SEGMENTS, {})
    assert fast_evaluation(wide, MESH, ATTACHMENTS) is None
