"""From a network's 8×8 maps to its vertices' offsets on one CPU thread, with all gradients: Fig. 3's convolutions.

The fast twin of `cnn.MapNetwork.maps` followed by `deformation_map.sample`. Three things make it fast, none of which
changes the function: a nearest-upsampled image shows the 3×3 kernel only 2×2 different pixels, so that each of the four
positions of an output pixel has a kernel of four taps; the 16 channels of a pixel are one vector (`tile_kernel`); the
map is sampled before the last 1×1 convolution, which then runs over vertices.

Images are (b, s + 2, s + 2, 16) float32 with a border of zeros, stored flat. Taps are (t, 16, 16), [tap, in, out].
"""

from functools import lru_cache
from typing import Any, no_type_check

import numpy as np
import torch
from numba import njit

from replicate.approximation.kernels.tile_kernel import TILE, correlate, multiply
from replicate.approximation.kernels.vector_code import CHANNELS
from replicate.engine.jit_cache import KEEP_CODE

# _SHARE[p, t, k]: whether row k of a 3×3 kernel falls on the t-th of the two source rows that a row of parity p shows.
_SHARE = np.array([[[1, 0, 0], [0, 1, 1]], [[1, 1, 0], [0, 0, 1]]], np.float32)
_SHARES = np.einsum("ptk,quj->pqtukj", _SHARE, _SHARE).reshape(16, 9)  # the same for rows and columns at once
_NOTHING = np.zeros(CHANNELS, np.float32)
_HERE = np.zeros(1, np.int64)
REORDER = {"reassoc", "contract", "nsz"}  # sums may be reordered, so that they can be vectors

_free: dict[int, list[np.ndarray]] = {}  # images between two steps; their borders stay zero


def _take(batch: int, size: int) -> np.ndarray:
    length = batch * (size + 2) ** 2 * CHANNELS
    free = _free.get(length)
    return free.pop() if free else np.zeros(length, np.float32)


def _give(*images: np.ndarray) -> None:
    for image in images:
        _free.setdefault(len(image), []).append(image)


@njit(cache=KEEP_CODE, error_model="numpy")
@no_type_check
def _convolve(image, x_scale, size, taps, offsets, bias, out, y_scale, firsts):
    """Write to `out` at y_scale·(r, c) + firsts[k] the sum over taps[k] of `image` at x_scale·(r, c) + offsets[k].

    (r, c) run over size² pixels. image, out: padded, x_scale·size and y_scale·size pixels a side. taps: (k, t, 16, 16).
    offsets: (k, t) and firsts: (k,), relative positions.
    """
    x_side, y_side = x_scale * size + 2, y_scale * size + 2
    for b in range(len(out) // (y_side * y_side * CHANNELS)):
        for k in range(len(taps)):
            for r in range(size):
                for c in range(0, size, TILE):
                    x = ((b * x_side + x_scale * r + 1) * x_side + x_scale * c + 1) * CHANNELS
                    y = ((b * y_side + y_scale * r + 1) * y_side + y_scale * c + 1) * CHANNELS + firsts[k]
                    multiply(out, y, y_scale * CHANNELS, image, x, x_scale * CHANNELS, offsets[k], taps[k], bias)


@njit(cache=KEEP_CODE, error_model="numpy")
@no_type_check
def _correlate(image, size, offsets, upstream, y_scale, firsts):
    """Return the gradients (k, t, 16, 16) of the taps that `_convolve` with x_scale 1 gave `upstream` from `image`."""
    x_side, y_side = size + 2, y_scale * size + 2
    x_row, y_row, step = x_side * CHANNELS, y_scale * y_side * CHANNELS, y_scale * CHANNELS
    gradient = np.zeros((*offsets.shape, CHANNELS, CHANNELS), np.float32)
    for b in range(len(image) // (x_side * x_side * CHANNELS)):
        for row in range(0, size, TILE):  # a few rows at a time stay in the nearest cache for all taps
            x, y = ((b * x_side + row + 1) * x_side + 1) * CHANNELS, ((b * y_side + 1) * y_side + 1) * CHANNELS
            for k in range(offsets.shape[0]):
                at = y + row * y_row + firsts[k]
                for t in range(offsets.shape[1]):
                    place = gradient[k, t]
                    correlate(place, image, x + offsets[k, t], CHANNELS, x_row, upstream, at, step, y_row, size, TILE)
    return gradient


@njit(cache=KEEP_CODE, error_model="numpy")
@no_type_check
def _activate(image, batch, size, slope):
    """Apply the leaky ReLU in place, all but the border."""
    side = size + 2
    for b in range(batch):
        for r in range(1, size + 1):
            row = image[((b * side + r) * side + 1) * CHANNELS : ((b * side + r + 1) * side - 1) * CHANNELS]
            for k in range(len(row)):
                row[k] = row[k] if row[k] > 0 else row[k] * slope


@njit(cache=KEEP_CODE, error_model="numpy")
@no_type_check
def _deactivate(upstream, image, batch, size, slope):
    """Take a gradient through the leaky ReLU that gave `image`, in place; return its sum over all pixels (16,)."""
    side = size + 2
    sums = np.zeros(CHANNELS, np.float32)
    for b in range(batch):
        for r in range(1, size + 1):
            first, last = ((b * side + r) * side + 1) * CHANNELS, ((b * side + r + 1) * side - 1) * CHANNELS
            row, values = upstream[first:last], image[first:last]
            for k in range(len(row)):
                row[k] = row[k] if values[k] > 0 else row[k] * slope
            for k in range(0, len(row), CHANNELS):
                for channel in range(CHANNELS):
                    sums[channel] += row[k + channel]
    return sums


@njit(cache=KEEP_CODE, inline="always", error_model="numpy")
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


@njit(cache=KEEP_CODE, error_model="numpy", fastmath=REORDER)
@no_type_check
def _read(image, size, pixels, shares, weight, bias, out):
    """Write to `out` (b, k, 3) what vertices read bilinearly from an image, through the last 1×1 convolution."""
    side = size + 2
    for b in range(len(out)):
        for i in range(len(pixels)):
            upper, lower = _pixels(image, b, pixels[i, 0], size, side)
            x, y, z = read_vertex(upper, lower, shares[i], weight)
            out[b, i, 0], out[b, i, 1], out[b, i, 2] = x + bias[0], y + bias[1], z + bias[2]


@njit(cache=KEEP_CODE, error_model="numpy", fastmath=REORDER)
@no_type_check
def _read_backward(image, size, pixels, shares, weight, upstream, out):
    """Write the gradient in the image to `out`; return those in the 1×1 convolution's weight and bias."""
    side, pixel_gradient = size + 2, np.empty(CHANNELS, np.float32)
    gradient, bias = np.zeros((3, CHANNELS), np.float32), np.zeros(3, np.float32)
    out[:] = 0
    for b in range(len(upstream)):
        for i in range(len(pixels)):
            upper, lower = _pixels(image, b, pixels[i, 0], size, side)
            s0, s1, s2, s3 = shares[i, 0], shares[i, 1], shares[i, 2], shares[i, 3]
            x, y, z = upstream[b, i, 0], upstream[b, i, 1], upstream[b, i, 2]
            bias[0] += x
            bias[1] += y
            bias[2] += z
            for c in range(CHANNELS):
                sample = upper[c] * s0 + upper[c + CHANNELS] * s1 + lower[c] * s2 + lower[c + CHANNELS] * s3
                gradient[0, c] += sample * x
                gradient[1, c] += sample * y
                gradient[2, c] += sample * z
            for c in range(CHANNELS):
                pixel_gradient[c] = weight[0, c] * x + weight[1, c] * y + weight[2, c] * z
            upper, lower = _pixels(out, b, pixels[i, 0], size, side)
            for c in range(CHANNELS):
                upper[c] += pixel_gradient[c] * s0
                upper[c + CHANNELS] += pixel_gradient[c] * s1
            for c in range(CHANNELS):
                lower[c] += pixel_gradient[c] * s2
                lower[c + CHANNELS] += pixel_gradient[c] * s3
    return gradient, bias


@njit(cache=KEEP_CODE, inline="always", error_model="numpy")
@no_type_check
def _pixels(image, b, pixel, size, side):
    """Return the two pixels of the upper row around a vertex, and the two of the lower row, as views."""
    at = ((b * side + pixel // size + 1) * side + pixel % size + 1) * CHANNELS
    below = at + side * CHANNELS
    return image[at : at + 2 * CHANNELS], image[below : below + 2 * CHANNELS]


def _flat(rows: np.ndarray, columns: np.ndarray, size: int) -> np.ndarray:
    """Return relative positions of pixels in a padded image of that size."""
    return np.ascontiguousarray((rows * (size + 2) + columns) * CHANNELS, np.int64)


@lru_cache
def _upsampling(size: int) -> tuple[np.ndarray, ...]:
    """Return where `_convolve` reads and writes on the way from size² to (2·size)² pixels, and on the way back.

    Four kernels (p, q), the parities of row and column, of four taps (t, u) each. Back, one kernel of all 16.
    """
    p, q, t, u = np.indices((2, 2, 2, 2)).reshape(4, 4, 4)
    firsts = _flat(p[:, 0], q[:, 0], 2 * size)
    return _flat(t + p - 1, u + q - 1, size), firsts, _flat(2 - p - 2 * t, 2 - q - 2 * u, 2 * size).reshape(1, 16)


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
    return np.ascontiguousarray(weight.transpose(order)).reshape(1, 9, CHANNELS, CHANNELS)


def fold(weight: np.ndarray) -> np.ndarray:
    """Return the taps (4, 4, 16, 16) of upsampling and a kernel (16, c, 3, 3), for each parity of row and column."""
    taps = np.zeros((4, 4, CHANNELS, CHANNELS), np.float32)
    taps[:, :, : weight.shape[1]] = (_SHARES @ weight.reshape(-1, 9).T).reshape(4, 4, CHANNELS, -1).swapaxes(2, 3)
    return taps


def unfold(taps: np.ndarray, channels: int) -> np.ndarray:
    """Return the gradient in the 3×3 kernel from that in its folded taps: the transpose of `fold`."""
    flat = taps[:, :, :channels].swapaxes(2, 3).reshape(16, -1)
    return np.ascontiguousarray((_SHARES.T @ flat).T).reshape(CHANNELS, channels, 3, 3)


class MapOffsets(torch.autograd.Function):
    """apply(start, slope, pixels, shares, *weights) → offsets (b, k, 3), before any scaling.

    start: (b, 8, 8, c ≤ 16). pixels, shares: of a `deformation_map.Bilinear`.
    weights: weight (16, c, 3, 3) and bias of each upsampling level, of the 3×3 convolution after them, and weight
    (3, 16) and bias of the last.
    """

    @staticmethod
    def forward(
        ctx: Any,
        start: torch.Tensor,
        slope: float,
        pixels: torch.Tensor,
        shares: torch.Tensor,
        *weights: torch.Tensor,
    ) -> torch.Tensor:
        arrays = [array.detach().contiguous().numpy() for array in weights]
        batch, s = start.shape[:2]
        images = [_take(batch, s)]
        _place(start.detach().numpy(), images[0])
        for level in range(0, len(arrays) - 4, 2):
            images.append(_take(batch, 2 * s))
            offsets, firsts, _ = _upsampling(s)
            _convolve(images[-2], 1, s, fold(arrays[level]), offsets, arrays[level + 1], images[-1], 2, firsts)
            s *= 2
            _activate(images[-1], batch, s, np.float32(slope))
        images.append(_take(batch, s))
        taps = _taps(arrays[-4], (2, 3, 1, 0))
        _convolve(images[-2], 1, s, taps, _around(s), arrays[-3], images[-1], 1, _HERE)
        _activate(images[-1], batch, s, np.float32(slope))
        out = np.empty((batch, len(pixels), 3), np.float32)
        _read(images[-1], s, pixels.numpy(), shares.numpy(), arrays[-2], arrays[-1], out)
        if any(ctx.needs_input_grad):
            ctx.images, ctx.arrays, ctx.slope, ctx.size = images, arrays, np.float32(slope), s
            ctx.grid, ctx.start_shape = (pixels.numpy(), shares.numpy()), start.shape
        else:
            _give(*images)
        return torch.from_numpy(out)

    @staticmethod
    def backward(ctx: Any, upstream: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        images, arrays, slope, s = ctx.images, ctx.arrays, ctx.slope, ctx.size
        batch, first, _, channels = ctx.start_shape
        trained = any(ctx.needs_input_grad[4:])  # not where the weights are frozen
        gradients = [None] * len(arrays)
        below, here = _take(batch, s), _take(batch, s)
        gradient = upstream.contiguous().numpy()
        gradients[-2:] = _read_backward(images[-1], s, *ctx.grid, arrays[-2], gradient, here)
        gradients[-3] = _deactivate(here, images[-1], batch, s, slope)
        taps = _taps(arrays[-4], (2, 3, 0, 1))
        _convolve(here, 1, s, taps, -_around(s), _NOTHING, below, 1, _HERE)
        if trained:
            kernel = _correlate(images[-2], s, _around(s), here, 1, _HERE).reshape(3, 3, CHANNELS, CHANNELS)
            gradients[-4] = np.ascontiguousarray(kernel.transpose(3, 2, 0, 1))
        _give(here)
        for level in range(len(arrays) - 6, -1, -2):
            here, s = below, s // 2
            gradients[level + 1] = _deactivate(here, images[level // 2 + 1], batch, 2 * s, slope)
            below = _take(batch, s)
            offsets, firsts, back = _upsampling(s)
            taps = np.ascontiguousarray(fold(arrays[level]).reshape(1, 16, CHANNELS, CHANNELS).swapaxes(2, 3))
            _convolve(here, 2, s, taps, back, _NOTHING, below, 1, _HERE)
            if trained:
                kernel = _correlate(images[level // 2], s, offsets, here, 2, firsts)
                gradients[level] = unfold(kernel, arrays[level].shape[1])
            _give(here)
        start = below.reshape(batch, first + 2, first + 2, CHANNELS)[:, 1:-1, 1:-1, :channels].copy()
        _give(below, *images)
        ctx.images = None
        weights = map(torch.from_numpy, gradients) if trained else [None] * len(gradients)
        return torch.from_numpy(start), None, None, None, *weights
