"""The kernel for eight pixels anywhere against its twin in NumPy."""

import numpy as np
import pytest
from numba import njit

from replicate.approximation.kernels.vector_code import CHANNELS
from replicate.inference.pixel_kernel import TILE, multiply_pixels, multiply_pixels_reference


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
