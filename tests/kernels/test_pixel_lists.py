"""The pixels that vertices depend on, against the convolutions themselves."""

import numpy as np
import pytest
import torch
from torch.nn import functional

from replicate.kernels.pixel_kernel import TILE, layers_of, places


def depended_on(pixels: np.ndarray, size: int, start: int) -> list[np.ndarray]:
    """Return which pixels of each image, the first to the last map, the vertices depend on: weights are all 1."""
    levels = (size // start).bit_length() - 1
    images = [torch.ones(1, 1, start, start, requires_grad=True)]
    kernel = torch.ones(1, 1, 3, 3)
    for _ in range(levels):
        shown = functional.interpolate(images[-1], scale_factor=2, mode="nearest")
        images.append(functional.conv2d(shown, kernel, padding=1))
    images.append(functional.conv2d(images[-1], kernel, padding=1))
    gradients = torch.autograd.grad(images[-1].flatten()[pixels.ravel()].sum(), images)
    return [gradient[0, 0].numpy() > 0 for gradient in gradients]


@pytest.mark.parametrize("size", [8, 16, 64])
@pytest.mark.parametrize("depth", [8, 16])
def test_each_layer_writes_what_the_next_one_reads_and_nothing_else(size, depth):
    corners = np.random.default_rng(size).integers(0, size - 1, (5, 2))
    pixels = np.array(
        [[r * size + c, r * size + c + 1, (r + 1) * size + c, (r + 1) * size + c + 1] for r, c in corners]
    )
    expected = depended_on(pixels, size, 8)
    layers = layers_of(pixels, size, 8, depth)
    sides = [8 * 2**level for level in range(1, len(layers))] + [size]
    for layer, side, needed in zip(layers, sides, expected[1:], strict=True):
        np.testing.assert_array_equal(layer.made, places(*np.nonzero(needed), side))
        assert layer.counts.sum() == needed.sum() and not (layer.ends % TILE).any()
        firsts = [0, *layer.ends[:-1]]
        listed = [layer.targets[first : first + n] for first, n in zip(firsts, layer.counts, strict=True)]
        np.testing.assert_array_equal(np.sort(np.concatenate(listed)), layer.made)
        for first, n, end in zip(firsts, layer.counts, layer.ends, strict=True):
            assert set(layer.targets[first:end]) == set(layer.targets[first : first + n])


def test_an_upsampling_layer_reads_the_pixel_that_it_shows():
    layer, _ = layers_of(np.array([[5 * 16 + 3, 5 * 16 + 4, 6 * 16 + 3, 6 * 16 + 4]]), 16, 8, depth=8)
    first = 0
    for parity, (end, n) in enumerate(zip(layer.ends, layer.counts, strict=True)):
        rows, columns = np.divmod(layer.targets[first : first + n] // 16, 18)
        read_rows, read_columns = np.divmod(layer.sources[first : first + n] // 8, 10)
        np.testing.assert_array_equal((rows - 1) % 2 * 2 + (columns - 1) % 2, parity)
        np.testing.assert_array_equal((rows - 1) // 2, read_rows - 1)
        np.testing.assert_array_equal((columns - 1) // 2, read_columns - 1)
        first = end
