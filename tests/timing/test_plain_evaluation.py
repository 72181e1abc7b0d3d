"""The plain evaluation of networks gives the offsets of the fast one."""

import numpy as np
import torch

from replicate.approximation.cnn import MapNetwork
from replicate.approximation.model import SegmentedModel
from replicate.approximation.refinement import RefinedModel
from replicate.approximation.segments import Segment
from replicate.baselines.dense import DenseNetwork
from replicate.timing.backends import plain_offsets

RNG = np.random.default_rng(0)


def map_model(first: int, vertex_count: int = 20) -> SegmentedModel:
    segments = []
    for k, vertices in enumerate((np.arange(first, first + 6), np.arange(first + 6, first + 10))):
        uv = RNG.uniform(0.1, 0.9, (len(vertices), 2)).astype(np.float32)
        segments.append(Segment(f"s{k}", vertices, uv, np.arange(k, 3)))
    torch.manual_seed(first)
    networks = [MapNetwork(len(s.parameters), s.uv, 16, 16, (64, 256), 0.2) for s in segments]
    return SegmentedModel(networks, segments, np.array([1.0, 2.0, 0.5], np.float32), (3.0, 0.5), vertex_count)


def test_the_plain_evaluation_of_maps_is_that_of_the_model():
    model, params = map_model(2), RNG.normal(size=(4, 3)).astype(np.float32)
    offsets = model.offsets(params)
    assert np.abs(offsets).max() > 0.01
    np.testing.assert_allclose(plain_offsets(model)(params), offsets, atol=1e-5)


def test_a_refinement_is_added():
    model, params = RefinedModel(map_model(2), map_model(8)), RNG.normal(size=(2, 3)).astype(np.float32)
    np.testing.assert_allclose(plain_offsets(model)(params), model.offsets(params), atol=1e-5)


def test_what_has_no_maps_has_no_plain_evaluation():
    coarse = map_model(0)
    dense = [DenseNetwork(len(s.parameters), len(s.vertices), (8,), 0.2) for s in coarse.segments]
    assert plain_offsets(SegmentedModel(dense, coarse.segments, coarse.scale, (1.0, 1.0), 20)) is None
