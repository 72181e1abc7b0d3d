"""Which pixels of a network's images matter: those that a vertex reads, and those that these are made from.

A vertex reads four pixels of the last map; a 3×3 convolution needs the nine around each of these, an upsampled pixel
the 2×2 that it shows. On a refinement square, which holds a hundred vertices on 64×64 pixels, these are few. Images are
flat, [row, column, channel], with a border of zeros. A list for `multiply_pixels` has whole tiles.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int, Int32

from replicate.approximation.kernels.pixel_kernel import TILE
from replicate.approximation.kernels.vector_code import CHANNELS

PARITIES = 4


class LayerPixels(NamedTuple):
    """The pixels that a layer writes, in a list for each parity of row and column if it upsamples, else in one.

    sources, targets: where they lie in the image that is read and in the one that is written, in whole tiles. ends:
    where each list ends. counts: how many of a list are pixels; what follows them repeats the last one. made: the
    targets of all, row by row.
    """

    sources: np.ndarray
    targets: np.ndarray
    ends: np.ndarray
    counts: np.ndarray
    made: np.ndarray


def layers_of(pixels: Int[np.ndarray, "k 4"], size: int, start: int, depth: int = CHANNELS) -> list[LayerPixels]:
    """Return the pixels of each layer, the first first: the upsampling ones, and the last convolution.

    pixels: that vertices read of the last map. size, start: pixels a side of the last and of the first image. depth:
    the channels of the first image as it is stored; all others have 16.
    """
    needed = np.zeros(size**2, bool)
    needed[pixels.ravel()] = True  # those of share zero, too: what isn't computed may be anything
    needed = needed.reshape(size, size)
    here = places(*np.nonzero(needed), size)
    layers, needed = [_listed([(here, here)], here)], grown(needed)
    while size > start:
        size //= 2
        channels, parts = depth if size == start else CHANNELS, []
        for p, q in np.ndindex(2, 2):
            rows, columns = np.nonzero(needed[p::2, q::2])
            written = places(2 * rows + p, 2 * columns + q, 2 * size)
            parts.append((places(rows, columns, size, channels), written))
        layers.insert(0, _listed(parts, places(*np.nonzero(needed), 2 * size)))
        needed = grown(needed).reshape(size, 2, size, 2).any(axis=(1, 3))
    return layers


def grown(needed: Bool[np.ndarray, "s s"]) -> Bool[np.ndarray, "s s"]:
    """Return the pixels that a 3×3 convolution reads to give some pixels."""
    padded = np.pad(needed, 1)
    n = len(needed)
    return np.any([padded[r : r + n, c : c + n] for r in range(3) for c in range(3)], axis=0)


def places(
    rows: Int[np.ndarray, " p"], columns: Int[np.ndarray, " p"], size: int, depth: int = CHANNELS
) -> Int32[np.ndarray, " p"]:
    """Return where pixels lie in an image with a border."""
    return np.asarray(((rows + 1) * (size + 2) + columns + 1) * depth, np.int32)


def _listed(parts: list[tuple[np.ndarray, np.ndarray]], made: np.ndarray) -> LayerPixels:
    whole = [tuple(np.concatenate([each, np.repeat(each[-1:], -len(each) % TILE)]) for each in part) for part in parts]
    sources, targets = (np.concatenate([part[side] for part in whole]) for side in (0, 1))
    ends = np.cumsum([len(part[0]) for part in whole])
    return LayerPixels(sources, targets, ends, np.array([len(part[0]) for part in parts]), made)
