"""The evaluation of map networks pixel by pixel against the networks themselves."""

import numpy as np
import pytest
import torch

from replicate.approximation.cnn import MapNetwork
from replicate.inference.map_evaluation import FastMaps, plan_maps

VERTICES, PARAMETERS = 60, 12


def planned(map_size, hidden, seed, vertex_count=20):
    """Return a network, its plan, the parameters and vertices that it has, and the scale of all parameters."""
    rng = np.random.default_rng(seed)
    torch.manual_seed(seed)
    parameters = np.sort(rng.permutation(PARAMETERS)[:7])
    vertices = np.sort(rng.permutation(VERTICES)[:vertex_count])
    scale = rng.uniform(0.5, 2, PARAMETERS).astype(np.float32)
    uv = rng.uniform(0, 1, (vertex_count, 2)).astype(np.float32)
    network = MapNetwork(7, uv, map_size, 16, hidden, 0.2)
    return network, plan_maps(network, parameters, vertices, scale, 3.0), parameters, vertices, scale


@pytest.mark.parametrize(
    ("map_size", "hidden"), [(16, (64, 512)), (32, (48, 256)), (64, (64, 1024)), (32, (40, 128)), (16, (24, 384))]
)
def test_offsets_are_those_of_the_maps_in_full(map_size, hidden):
    network, plan, parameters, vertices, scale = planned(map_size, hidden, seed=map_size)
    fast = FastMaps([plan])
    for params in np.random.default_rng(1).uniform(-1, 1, (4, PARAMETERS)).astype(np.float32):
        out = np.zeros((VERTICES, 3), np.float32)
        fast.place(params, out)
        with torch.no_grad():
            truth = 3.0 * network(torch.from_numpy(params / scale)[None, parameters])[0].numpy()
        assert np.abs(truth).max() > 0.01
        np.testing.assert_allclose(out[vertices], truth, atol=1e-5)
        assert not np.delete(out, vertices, axis=0).any()


def test_networks_add_to_what_is_there():
    parts = [planned(16, (64, 512), seed) for seed in (1, 2)]
    params = np.linspace(-1, 1, PARAMETERS, dtype=np.float32)
    both, apart = np.ones((VERTICES, 3), np.float32), np.ones((VERTICES, 3), np.float32)
    FastMaps([part[1] for part in parts]).place(params, both)
    for part in parts:
        FastMaps([part[1]]).place(params, apart)
    np.testing.assert_array_equal(both, apart)
    assert np.abs(both - 1).max() > 0.01


def test_pixels_that_no_vertex_reads_are_left_out():
    few, many = (planned(64, (64, 512), seed=3, vertex_count=k)[1] for k in (3, 50))
    assert len(few.sources[-1]) < len(many.sources[-1]) < 64**2
    assert all(len(places) % 8 == 0 for places in few.sources)
