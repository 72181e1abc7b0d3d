"""The vector kernels of gradients against their plain twins."""

import numpy as np
from numba import njit

from replicate.kernels.gradient_kernel import (
    deactivate_pixels,
    deactivate_pixels_plain,
    read_back,
    read_back_plain,
)
from replicate.kernels.vector_code import CHANNELS


@njit
def deactivate(upstream, image, made, slope, sums):
    deactivate_pixels(upstream, image, made, np.float32(slope), sums)


def test_a_gradient_goes_through_the_leaky_relu_of_the_listed_pixels():
    rng = np.random.default_rng(3)
    image = rng.normal(size=50 * CHANNELS).astype(np.float32)
    made = CHANNELS * rng.permutation(50)[:20].astype(np.int32)
    gradients, sums = (np.ones(50 * CHANNELS, np.float32) for _ in range(2)), np.ones((2, CHANNELS), np.float32)
    fast, clear = gradients
    deactivate(fast, image, made, 0.2, sums[0])
    deactivate_pixels_plain(clear, image, made, 0.2, sums[1])
    assert set(np.unique(clear)) == {np.float32(0.2), np.float32(1)} and (clear == 1).sum() > 30 * CHANNELS
    np.testing.assert_array_equal(fast, clear)
    np.testing.assert_array_equal(sums[0], sums[1])


@njit
def back(image, upper, below, shares, weight, upstream, out, gradient):
    read_back(image, upper, below, shares, weight, upstream, out, gradient)


def test_what_vertices_read_gets_their_gradients_also_where_they_share_a_pixel():
    rng = np.random.default_rng(4)
    image = rng.normal(size=60 * CHANNELS).astype(np.float32)
    upper = CHANNELS * np.array([0, 1, 1, 30, 12], np.int32)
    shares, upstream = rng.uniform(size=(5, 4)).astype(np.float32), rng.normal(size=(5, 3)).astype(np.float32)
    weight = rng.normal(size=(3, CHANNELS)).astype(np.float32)
    fast, clear = ((np.ones(60 * CHANNELS, np.float32), np.ones((3, CHANNELS), np.float32)) for _ in range(2))
    rest = (image, upper, 10 * CHANNELS, shares, weight, upstream)
    back(*rest, *fast)
    read_back_plain(*rest, *clear)
    for one, other in zip(fast, clear, strict=True):
        assert np.abs(other - 1).max() > 0.5
        np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-5)
