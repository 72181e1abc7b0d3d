"""The vector kernels, for pixels anywhere, against their plain twins."""

import numpy as np
import pytest
from numba import njit

from replicate.kernels.pixel_kernel import (
    TILE,
    add_pixels,
    add_pixels_plain,
    correlate_pixels,
    correlate_pixels_plain,
    multiply_pixels,
    multiply_pixels_plain,
)
from replicate.kernels.vector_code import CHANNELS


@njit
def run(out, targets, image, sources, first, offsets, taps, channels, bias, slope):
    multiply_pixels(out, targets, image, sources, first, offsets, taps, channels, bias, np.float32(slope))


@pytest.mark.parametrize("channels", [8, 16])
def test_the_kernel_gives_what_its_plain_twin_gives(channels):
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
    multiply_pixels_plain(clear, targets, *rest)
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
    for out, run_it in ((fast, add), (clear, add_pixels_plain)):
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
    correlate_pixels_plain(clear, *rest)
    assert np.abs(clear - 1).max() > 1
    np.testing.assert_allclose(fast, clear, rtol=1e-4, atol=1e-4)
    before = fast.copy()
    correlate(fast, *rest[:5], 4, 4)
    np.testing.assert_array_equal(fast, before, "an empty part adds nothing")
