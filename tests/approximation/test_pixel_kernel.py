"""The vector kernels, for pixels anywhere, against their plain twins."""

import numpy as np
import pytest
from numba import njit

from replicate.approximation.kernels.pixel_kernel import (
    TILE,
    add_pixels,
    add_pixels_reference,
    correlate_pixels,
    correlate_pixels_reference,
    deactivate_pixels,
    deactivate_pixels_reference,
    multiply_pixels,
    multiply_pixels_reference,
    read_back,
    read_back_reference,
)
from replicate.approximation.kernels.vector_code import CHANNELS


@njit
def run(out, targets, image, sources, first, offsets, taps, channels, bias, slope):
    multiply_pixels(out, targets, image, sources, first, offsets, taps, channels, bias, np.float32(slope))


@pytest.mark.parametrize("channels", [8, 16])
def test_the_kernel_gives_what_its_reference_gives(channels):
    rng = np.random.default_rng(channels)
    image = rng.normal(size=100 * channels).astype(np.float32)
    sources = channels * rng.permutation(90)[: 2 * TILE].astype(np.int32)
    targets = CHANNELS * rng.permutation(40)[: 2 * TILE].astype(np.int32)
    offsets = np.array([0, channels, 5 * channels], np.int32)
    taps = rng.normal(size=3 * channels * CHANNELS).astype(np.float32)
    bias = rng.normal(size=CHANNELS).astype(np.float32)
    fast, clear = np.zeros(40 * CHANNELS, np.float32), np.zeros(40 * CHANNELS, np.float32)
    rest = (image, sources, TILE, offsets, taps, channels, bias, 0.2)
    run(fast, targets, *rest)
    multiply_pixels_reference(clear, targets, *rest)
    assert np.abs(clear).max() > 1
    np.testing.assert_allclose(fast, clear, rtol=1e-4, atol=1e-4)


@njit
def add(out, targets, shift, image, sources, first, tap):
    add_pixels(out, targets, shift, image, sources, first, tap)


def test_what_is_added_to_a_pixel_that_a_tile_repeats_is_added_once():
    rng = np.random.default_rng(2)
    image, tap = rng.normal(size=100 * CHANNELS).astype(np.float32), rng.normal(size=CHANNELS**2).astype(np.float32)
    sources, targets = (CHANNELS * rng.permutation(90)[: 2 * TILE].astype(np.int32) for _ in range(2))
    sources[-3:], targets[-3:] = sources[-4], targets[-4]
    fast, clear = (np.ones(100 * CHANNELS, np.float32) for _ in range(2))
    for out, run_it in ((fast, add), (clear, add_pixels_reference)):
        run_it(out, targets, 2 * CHANNELS, image, sources, TILE, tap)
    assert (np.abs(clear - 1).reshape(-1, CHANNELS).max(1) > 0).sum() == TILE - 3
    np.testing.assert_allclose(fast, clear, rtol=1e-4, atol=1e-4)


@njit
def correlate(gradient, image, sources, offset, upstream, targets, first, last):
    correlate_pixels(gradient, image, sources, offset, upstream, targets, first, last)


def test_correlations_add_the_products_of_a_part_of_the_list():
    rng = np.random.default_rng(1)
    image, upstream = rng.normal(size=(2, 100 * CHANNELS)).astype(np.float32)
    sources, targets = (CHANNELS * rng.permutation(90)[:20].astype(np.int32) for _ in range(2))
    fast, clear = (np.ones((CHANNELS, CHANNELS), np.float32) for _ in range(2))
    rest = (image, sources, 3 * CHANNELS, upstream, targets, 2, 15)
    correlate(fast, *rest)
    correlate_pixels_reference(clear, *rest)
    assert np.abs(clear - 1).max() > 1
    np.testing.assert_allclose(fast, clear, rtol=1e-4, atol=1e-4)
    before = fast.copy()
    correlate(fast, *rest[:5], 4, 4)
    np.testing.assert_array_equal(fast, before, "an empty part adds nothing")


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
    deactivate_pixels_reference(clear, image, made, 0.2, sums[1])
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
    read_back_reference(*rest, *clear)
    for one, other in zip(fast, clear, strict=True):
        assert np.abs(other - 1).max() > 0.5
        np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-5)
