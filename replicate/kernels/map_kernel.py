"""From a network's 8×8 maps to its vertices' offsets on one CPU thread, with all gradients: Fig. 3's convolutions.

The fast twin of `cnn.MapNetwork.maps` followed by `deformation_map.sample`. Four things make it fast, none of which
changes the function: a nearest-upsampled image shows the 3×3 kernel only 2×2 different pixels, so that each of the four
positions of an output pixel has a kernel of four taps; the 16 channels of a pixel are one vector (`pixel_kernel`); the
map is sampled before the last 1×1 convolution, which then runs over vertices; and pixels that no vertex depends on are
left out, forwards and backwards (`pixel_kernel`).

Images are (b, s + 2, s + 2, 16) float32 with a border of zeros, stored flat. Taps are (t, 16, 16), [tap, in, out].
What an image holds elsewhere than in its layer's pixels and on the border is of no meaning; gradients are zero there.
"""

from functools import lru_cache
from typing import Any, NamedTuple, no_type_check

import numpy as np
import torch
from numba import njit

from replicate.base.jit_cache import kept
from replicate.kernels.gradient_kernel import deactivate_pixels, read_back
from replicate.kernels.pixel_kernel import TILE, LayerPixels, add_pixels, correlate_pixels, multiply_pixels
from replicate.kernels.vector_code import CHANNELS

# _SHARE[p, t, k]: whether row k of a 3×3 kernel falls on the t-th of the two source rows that a row of parity p shows.
_SHARE = np.array([[[1, 0, 0], [0, 1, 1]], [[1, 1, 0], [0, 0, 1]]], np.float32)
_SHARES = np.einsum("ptk,quj->pqtukj", _SHARE, _SHARE).reshape(16, 9)  # the same for rows and columns at once
_CACHED = 512  # pixels whose vectors stay in the nearest cache for all taps
REORDER = {"reassoc", "contract", "nsz"}  # sums may be reordered, so that they can be vectors

_images: dict[int, list[np.ndarray]] = {}  # between two steps, by length; their borders stay zero
_gradients: dict[int, list[np.ndarray]] = {}  # the same of gradients, whose borders hold what falls on them


def _take(free: dict[int, list[np.ndarray]], batch: int, size: int) -> np.ndarray:
    length = batch * (size + 2) ** 2 * CHANNELS
    return free[length].pop() if free.get(length) else np.zeros(length, np.float32)


def _give(free: dict[int, list[np.ndarray]], *images: np.ndarray) -> None:
    for image in images:
        free.setdefault(len(image), []).append(image)


def _no_gradient(batch: int, size: int) -> np.ndarray:
    """Return the gradient in an image, zero everywhere."""
    image = _take(_gradients, batch, size)
    image[:] = 0
    return image


@kept
@njit(error_model="numpy")
@no_type_check
def _convolve(image, batch, sources, targets, ends, taps, offsets, bias, slope, out):
    """Write to `out` at a layer's targets the sums over taps of `image` at its sources + offsets, as leaky ReLUs.

    sources, targets, ends: of `LayerPixels`, a list for each kernel. taps: (k, t·16·16). offsets: (k, t), in places.
    """
    x_length, y_length = len(image) // batch, len(out) // batch
    for b in range(batch):
        x, y = image[b * x_length : (b + 1) * x_length], out[b * y_length : (b + 1) * y_length]
        first = 0
        for k in range(len(taps)):
            for place in range(first, ends[k], TILE):
                multiply_pixels(y, targets, x, sources, place, offsets[k], taps[k], CHANNELS, bias, slope)
            first = ends[k]


@kept
@njit(error_model="numpy")
@no_type_check
def _go_back(upstream, batch, sources, targets, ends, taps, offsets, out):
    """Add to `out`, the gradient in what `_convolve` reads, what `upstream`, that in its sums, gives it.

    taps: (k, t, 16·16), [kernel, tap, out and in]. Tap after tap, so that sums have the order of a pixel at a time.
    """
    x_length, y_length = len(out) // batch, len(upstream) // batch
    for b in range(batch):
        x, y = out[b * x_length : (b + 1) * x_length], upstream[b * y_length : (b + 1) * y_length]
        first = 0
        for k in range(len(taps)):
            for t in range(offsets.shape[1]):
                for place in range(first, ends[k], TILE):
                    add_pixels(x, sources, offsets[k, t], y, targets, place, taps[k, t])
            first = ends[k]


@kept
@njit(error_model="numpy")
@no_type_check
def _correlate(image, batch, sources, targets, ends, counts, offsets, upstream):
    """Return the gradients (k, t, 16, 16) of the taps that `_convolve` gave `upstream` from `image`."""
    x_length, y_length = len(image) // batch, len(upstream) // batch
    gradient = np.zeros((*offsets.shape, CHANNELS, CHANNELS), np.float32)
    for b in range(batch):
        x, y = image[b * x_length : (b + 1) * x_length], upstream[b * y_length : (b + 1) * y_length]
        first = 0
        for k in range(offsets.shape[0]):
            end = first + counts[k]
            for start in range(first, end, _CACHED):
                for t in range(offsets.shape[1]):
                    last = min(start + _CACHED, end)
                    correlate_pixels(gradient[k, t], x, sources, offsets[k, t], y, targets, start, last)
            first = ends[k]
    return gradient


@kept
@njit(error_model="numpy")
@no_type_check
def _deactivate(upstream, image, batch, made, slope):
    """Take a gradient through the leaky ReLU that gave `image`, in place; return its sum over all pixels (16,)."""
    sums, length = np.zeros(CHANNELS, np.float32), len(image) // batch
    for b in range(batch):
        pose = slice(b * length, (b + 1) * length)
        deactivate_pixels(upstream[pose], image[pose], made, slope, sums)
    return sums


@kept
@njit(inline="always", error_model="numpy")
@no_type_check
def read_vertex(
    upper: np.ndarray, lower: np.ndarray, shares: np.ndarray, weight: np.ndarray
) -> tuple[float, float, float]:
    """Return a vertex's bilinear sample of two pairs of pixels through the 1×1 convolution, without its bias."""
    s0, s1, s2, s3 = shares[0], shares[1], shares[2], shares[3]
    x, y, z = np.float32(0), np.float32(0), np.float32(0)
    for c in range(CHANNELS):
        sample = upper[c] * s0 + upper[c + CHANNELS] * s1 + lower[c] * s2 + lower[c + CHANNELS] * s3
        x += sample * weight[0, c]
        y += sample * weight[1, c]
        z += sample * weight[2, c]
    return x, y, z


@kept
@njit(error_model="numpy", fastmath=REORDER)
@no_type_check
def _read(image, size, upper, shares, weight, bias, out):
    """Write to `out` (b, k, 3) what vertices read bilinearly from an image, through the last 1×1 convolution."""
    length, below = len(image) // len(out), (size + 2) * CHANNELS
    for b in range(len(out)):
        for i in range(len(upper)):
            at = b * length + upper[i]
            pair, lower = image[at : at + 2 * CHANNELS], image[at + below : at + below + 2 * CHANNELS]
            x, y, z = read_vertex(pair, lower, shares[i], weight)
            out[b, i, 0], out[b, i, 1], out[b, i, 2] = x + bias[0], y + bias[1], z + bias[2]


@kept
@njit(error_model="numpy")
@no_type_check
def _read_backward(image, size, upper, shares, weight, upstream, out):
    """Add the gradient in the image to `out`; return those in the 1×1 convolution's weight and bias."""
    gradient, bias = np.zeros((3, CHANNELS), np.float32), np.zeros(3, np.float32)
    length, below = len(image) // len(upstream), (size + 2) * CHANNELS
    for b in range(len(upstream)):
        pose = slice(b * length, (b + 1) * length)
        read_back(image[pose], upper, below, shares, weight, upstream[b], out[pose], gradient)
        for i in range(upstream.shape[1]):
            for k in range(3):
                bias[k] += upstream[b, i, k]
    return gradient, bias


def _flat(rows: np.ndarray, columns: np.ndarray, size: int) -> np.ndarray:
    """Return relative places of pixels in a padded image of that size."""
    return np.ascontiguousarray((rows * (size + 2) + columns) * CHANNELS, np.int32)


@lru_cache
def _upsampling(size: int) -> np.ndarray:
    """Return the offsets of `_convolve` from size² to (2·size)² pixels.

    Four kernels (p, q), the parities of row and column, of four taps (t, u) each.
    """
    p, q, t, u = np.indices((2, 2, 2, 2)).reshape(4, 4, 4)
    return _flat(t + p - 1, u + q - 1, size)


@lru_cache
def _around(size: int) -> np.ndarray:
    """Return where the nine taps of a 3×3 kernel lie."""
    row, column = np.indices((3, 3)).reshape(2, 1, 9) - 1
    return _flat(row, column, size)


def _place(start: np.ndarray, image: np.ndarray) -> None:
    """Copy (b, 8, 8, c) into a padded image; channels beyond c become zero."""
    b, s, _, c = start.shape
    inside = image.reshape(b, s + 2, s + 2, CHANNELS)[:, 1:-1, 1:-1]
    inside[..., :c], inside[..., c:] = start, 0


def _taps(weight: np.ndarray, order: tuple[int, ...]) -> np.ndarray:
    return np.ascontiguousarray(weight.transpose(order)).reshape(1, 9, CHANNELS**2)


def fold(weight: np.ndarray) -> np.ndarray:
    """Return the taps (4, 4, 16, 16) of upsampling and a kernel (16, c, 3, 3), for each parity of row and column."""
    taps = np.zeros((4, 4, CHANNELS, CHANNELS), np.float32)
    taps[:, :, : weight.shape[1]] = (_SHARES @ weight.reshape(-1, 9).T).reshape(4, 4, CHANNELS, -1).swapaxes(2, 3)
    return taps


def unfold(taps: np.ndarray, channels: int) -> np.ndarray:
    """Return the gradient in the 3×3 kernel from that in its folded taps: the transpose of `fold`."""
    flat = taps[:, :, :channels].swapaxes(2, 3).reshape(16, -1)
    return np.ascontiguousarray((_SHARES.T @ flat).T).reshape(CHANNELS, channels, 3, 3)


class Grid(NamedTuple):
    """How vertices read a network's last map, and what that takes.

    upper: (k,) int32, where the first of a vertex's four pixels lies in the image. shares: (k, 4), of a `Bilinear`.
    layers: the pixels of each layer that this needs, from the 8×8 maps on (`pixel_kernel.layers_of`).
    """

    upper: np.ndarray
    shares: np.ndarray
    layers: list[LayerPixels]


class MapOffsets(torch.autograd.Function):
    """apply(start, slope, grid, *weights) → offsets (b, k, 3), before any scaling.

    start: (b, 8, 8, c ≤ 16). grid: a `Grid`. weights: weight (16, c, 3, 3) and bias of each upsampling level, of the
    3×3 convolution after them, and weight (3, 16) and bias of the last.
    """

    @staticmethod
    def forward(ctx: Any, start: torch.Tensor, slope: float, grid: Grid, *weights: torch.Tensor) -> torch.Tensor:
        arrays = [array.detach().contiguous().numpy() for array in weights]
        (batch, s), slope = start.shape[:2], np.float32(slope)
        images, folded = [_take(_images, batch, s)], []
        _place(start.detach().numpy(), images[0])
        for level, layer in enumerate(grid.layers[:-1]):
            images.append(_take(_images, batch, 2 * s))
            folded.append(fold(arrays[2 * level]))
            taps, bias = folded[-1].reshape(4, -1), arrays[2 * level + 1]
            _convolve(images[-2], batch, *layer[:3], taps, _upsampling(s), bias, slope, images[-1])
            s *= 2
        images.append(_take(_images, batch, s))
        taps, layer = _taps(arrays[-4], (2, 3, 1, 0)).reshape(1, -1), grid.layers[-1]
        _convolve(images[-2], batch, *layer[:3], taps, _around(s), arrays[-3], slope, images[-1])
        out = np.empty((batch, len(grid.upper), 3), np.float32)
        _read(images[-1], s, grid.upper, grid.shares, arrays[-2], arrays[-1], out)
        if any(ctx.needs_input_grad):
            ctx.images, ctx.arrays, ctx.folded, ctx.slope, ctx.size = images, arrays, folded, slope, s
            ctx.grid, ctx.start_shape = grid, start.shape
        else:
            _give(_images, *images)
        return torch.from_numpy(out)

    @staticmethod
    def backward(ctx: Any, upstream: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        images, arrays, slope, s, grid = ctx.images, ctx.arrays, ctx.slope, ctx.size, ctx.grid
        batch, first, _, channels = ctx.start_shape
        trained = any(ctx.needs_input_grad[3:])  # not where the weights are frozen
        gradients = [None] * len(arrays)
        layer = grid.layers[-1]
        below, here = _no_gradient(batch, s), _no_gradient(batch, s)
        gradient = upstream.contiguous().numpy()
        gradients[-2:] = _read_backward(images[-1], s, grid.upper, grid.shares, arrays[-2], gradient, here)
        gradients[-3] = _deactivate(here, images[-1], batch, layer.made, slope)
        taps = _taps(arrays[-4], (2, 3, 0, 1))
        _go_back(here, batch, *layer[:3], taps, _around(s), below)
        if trained:
            kernel = _correlate(images[-2], batch, *layer[:4], _around(s), here).reshape(3, 3, CHANNELS, CHANNELS)
            gradients[-4] = np.ascontiguousarray(kernel.transpose(3, 2, 0, 1))
        _give(_gradients, here)
        for level in reversed(range(len(grid.layers) - 1)):
            layer, here, s = grid.layers[level], below, s // 2
            gradients[2 * level + 1] = _deactivate(here, images[level + 1], batch, layer.made, slope)
            below, offsets = _no_gradient(batch, s), _upsampling(s)
            taps = np.ascontiguousarray(ctx.folded[level].swapaxes(2, 3)).reshape(4, 4, CHANNELS**2)
            _go_back(here, batch, *layer[:3], taps, offsets, below)
            if trained:
                kernel = _correlate(images[level], batch, *layer[:4], offsets, here)
                gradients[2 * level] = unfold(kernel, arrays[2 * level].shape[1])
            _give(_gradients, here)
        start = below.reshape(batch, first + 2, first + 2, CHANNELS)[:, 1:-1, 1:-1, :channels].copy()
        _give(_gradients, below)
        _give(_images, *images)
        ctx.images = None
        weights = map(torch.from_numpy, gradients) if trained else [None] * len(gradients)
        return torch.from_numpy(start), None, None, *weights
