"""The two vector kernels against their plain twins."""

import numpy as np
from numba import njit

from replicate.approximation.kernels import tile_kernel as tiles

RNG = np.random.default_rng(0)


@njit
def multiply(y, y_first, y_step, x, x_first, x_step, offsets, weights, start):
    tiles.multiply(y, y_first, y_step, x, x_first, x_step, offsets, weights, start)


@njit
def correlate(gradient, x, x_first, x_step, x_row, y, y_first, y_step, y_row, columns, rows):
    tiles.correlate(gradient, x, x_first, x_step, x_row, y, y_first, y_step, y_row, columns, rows)


def numbers(*shape):
    return RNG.normal(size=shape).astype(np.float32)


def test_multiply_writes_its_tile_and_nothing_else():
    x, weights, start = numbers(2000), numbers(5, 16, 16), numbers(16)
    offsets = np.array([-48, 0, 7, 160, 16], np.int64)
    results = [np.zeros(2000, np.float32) for _ in range(2)]
    for run, y in zip((tiles.multiply_reference, multiply), results, strict=True):
        run(y, 100, 32, x, 200, 16, offsets, weights, start)
    assert np.abs(results[0]).max() > 1
    np.testing.assert_allclose(results[1], results[0], atol=1e-4)
    assert not results[1][:100].any() and not results[1][100 + 7 * 32 + 16 :].any()


def test_correlate_adds_the_products_of_all_pixels():
    x, y = numbers(4000), numbers(4000)
    results = [np.ones((16, 16), np.float32) for _ in range(2)]
    for run, gradient in zip((tiles.correlate_reference, correlate), results, strict=True):
        run(gradient, x, 16, 16, 320, y, 48, 32, 640, 8, 5)
    assert np.abs(results[0] - 1).max() > 1
    np.testing.assert_allclose(results[1], results[0], atol=1e-4)
