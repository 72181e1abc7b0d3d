"""From a network's 8×8 maps to its vertices' offsets on one CPU thread, with all gradients: Fig. 3's convolutions.

The fast twin of `cnn.MapNetwork.maps` followed by `deformation_map.sample`. Three things make it fast, none of which
changes the function: a nearest-upsampled image shows the 3×3 kernel only 2×2 different pixels, so that each of the four
positions of an output pixel has a kernel of four taps; the 16 channels of a pixel are one vector (`tile_kernel`); the
map is sampled before the last 1×1 convolution, which then runs over vertices.

Images are (b, s + 2, s + 2, 16) float32 with a border of zeros, kept flat. Taps are (t, 16, 16), [tap, in, out].
"""

from typing import no_type_check

import numpy as np
import torch
from numba import njit

from replicate.approximation.tile_kernel import CHANNELS, TILE, correlate, multiply

# _SHARE[p, t, k]: whether row k of a 3×3 kernel falls on the t-th of the two source rows that a row of parity p shows.
_SHARE = np.array([[[1, 0, 0], [0, 1, 1]], [[1, 1, 0], [0, 0, 1]]], np.float32)
_NOTHING = np.zeros(CHANNELS, np.float32)

_free: dict[int, list[np.ndarray]] = {}  # images between two steps; their borders stay zero


def _take(batch: int, size: int) -> np.ndarray:
    length = batch * (size + 2) ** 2 * CHANNELS
    free = _free.get(length)
    return free.pop() if free else np.zeros(length, np.float32)


def _give(*images: np.ndarray) -> None:
    for image in images:
        _free.setdefault(len(image), []).append(image)


@njit(error_model="numpy")
@no_type_check
def _fold(weight):
    """Return the taps (2, 2, 4, 16, 16) of upsampling and a kernel (16, c, 3, 3), for each parity of row and column."""
    taps = np.zeros((2, 2, 4, CHANNELS, CHANNELS), np.float32)
    for p, q, t, u, k, j in np.ndindex(2, 2, 2, 2, 3, 3):
        if _SHARE[p, t, k] * _SHARE[q, u, j]:
            taps[p, q, 2 * t + u, : weight.shape[1]] += weight[:, :, k, j].T
    return taps


@njit(error_model="numpy")
@no_type_check
def _unfold(taps, channels):
    """Return the gradient in the 3×3 kernel from that in its folded taps: the transpose of `_fold`."""
    weight = np.zeros((CHANNELS, channels, 3, 3), np.float32)
    for p, q, t, u, k, j in np.ndindex(2, 2, 2, 2, 3, 3):
        if _SHARE[p, t, k] * _SHARE[q, u, j]:
            weight[:, :, k, j] += taps[p, q, 2 * t + u, :channels].T
    return weight


@njit(error_model="numpy")
@no_type_check
def _transposed(taps):
    out = np.empty_like(taps)
    for t in range(len(taps)):
        out[t] = taps[t].T
    return out


@njit(error_model="numpy")
@no_type_check
def _place(start, image):
    """Copy (b, 8, 8, c) into a padded image; channels beyond c stay zero."""
    b, s, _, c = start.shape
    padded = image.reshape(b, s + 2, s + 2, CHANNELS)
    padded[:, 1 : s + 1, 1 : s + 1, :c] = start
    padded[:, 1 : s + 1, 1 : s + 1, c:] = 0


@njit(error_model="numpy")
@no_type_check
def _convolve(image, size, y_size, taps, offsets, bias, out, first, x_scale, y_scale):
    """Write the taps' sum over `image` at every tile of `size`×`size` pixels (r, c) to `out`, both padded.

    Read at x_scale·(r, c), written at y_scale·(r, c) + first; offsets are relative positions in `image`, whose side is
    x_scale·size.
    """
    x_side, y_side = x_scale * size + 2, y_size + 2
    for b in range(len(out) // (y_side * y_side * CHANNELS)):
        for r in range(size):
            for c in range(0, size, TILE):
                x = ((b * x_side + x_scale * r + 1) * x_side + x_scale * c + 1) * CHANNELS
                y = ((b * y_side + y_scale * r + 1) * y_side + y_scale * c + 1) * CHANNELS + first
                multiply(out, y, y_scale * CHANNELS, image, x, x_scale * CHANNELS, offsets, taps, bias)


@njit(error_model="numpy")
@no_type_check
def _correlate(image, upstream, size, y_scale, offset, first, gradient):
    """Add one tap's gradient (16, 16): `image`, at (r, c) + offset, times `upstream`, at y_scale·(r, c) + first."""
    x_side, y_side = size + 2, y_scale * size + 2
    for b in range(len(image) // (x_side * x_side * CHANNELS)):
        x = ((b * x_side + 1) * x_side + 1) * CHANNELS + offset
        y = ((b * y_side + 1) * y_side + 1) * CHANNELS + first
        x_row, y_row = x_side * CHANNELS, y_scale * y_side * CHANNELS
        correlate(gradient, image, x, CHANNELS, x_row, upstream, y, y_scale * CHANNELS, y_row, size, size)


@njit(error_model="numpy")
@no_type_check
def _activate(image, batch, size, slope):
    """Apply the leaky ReLU in place, all but the border."""
    side = size + 2
    for b in range(batch):
        for r in range(1, size + 1):
            row = image[((b * side + r) * side + 1) * CHANNELS : ((b * side + r + 1) * side - 1) * CHANNELS]
            for k in range(len(row)):
                row[k] = row[k] if row[k] > 0 else row[k] * slope


@njit(error_model="numpy")
@no_type_check
def _deactivate(upstream, image, batch, size, slope):
    """Take a gradient through the leaky ReLU that gave `image`, in place; return its sum over all pixels (16,)."""
    side = size + 2
    sums = np.zeros(CHANNELS, np.float32)
    for b in range(batch):
        for r in range(1, size + 1):
            first, last = ((b * side + r) * side + 1) * CHANNELS, ((b * side + r + 1) * side - 1) * CHANNELS
            row, shown = upstream[first:last], image[first:last]
            for k in range(len(row)):
                row[k] = row[k] if shown[k] > 0 else row[k] * slope
            for k in range(0, len(row), CHANNELS):
                for channel in range(CHANNELS):
                    sums[channel] += row[k + channel]
    return sums


@njit(error_model="numpy")
@no_type_check
def _phase_offsets(side, p, q):
    """Return where the four taps of output pixels of parity (p, q) lie in a source image of that padded side."""
    offsets = np.empty(4, np.int64)
    for t, u in np.ndindex(2, 2):
        offsets[2 * t + u] = ((t + p - 1) * side + u + q - 1) * CHANNELS
    return offsets


@njit(error_model="numpy")
@no_type_check
def _kernel_offsets(side):
    offsets = np.empty(9, np.int64)
    for k, j in np.ndindex(3, 3):
        offsets[3 * k + j] = ((k - 1) * side + j - 1) * CHANNELS
    return offsets


@njit(error_model="numpy")
@no_type_check
def _upsample(image, size, weight, bias, out, slope):
    """Write the leaky ReLU of the 3×3 convolution of the upsampled image to `out`, padded (2·size)²."""
    taps, side = _fold(weight), 2 * size + 2
    for p, q in np.ndindex(2, 2):
        first = (p * side + q) * CHANNELS
        _convolve(image, size, 2 * size, taps[p, q], _phase_offsets(size + 2, p, q), bias, out, first, 1, 2)
    _activate(out, len(out) // (side * side * CHANNELS), 2 * size, slope)


@njit(error_model="numpy")
@no_type_check
def _upsample_backward(image, size, weight, upstream, out):
    """Write the gradient in `image` to `out`; return that in the weight. upstream: before the activation."""
    taps, side = _fold(weight), 2 * size + 2
    gradient, offsets = np.zeros_like(taps), np.empty(16, np.int64)
    back = np.empty((16, CHANNELS, CHANNELS), np.float32)
    for p, q, t, u in np.ndindex(2, 2, 2, 2):
        first, tap = (p * side + q) * CHANNELS, 2 * t + u
        offset = _phase_offsets(size + 2, p, q)[tap]
        _correlate(image, upstream, size, 2, offset, first, gradient[p, q, tap])
        offsets[8 * p + 4 * q + tap] = ((2 - p - 2 * t) * side + 2 - q - 2 * u) * CHANNELS
        back[8 * p + 4 * q + tap] = taps[p, q, tap].T
    _convolve(upstream, size, size, back, offsets, _NOTHING, out, 0, 2, 1)
    return _unfold(gradient, weight.shape[1])


@njit(error_model="numpy")
@no_type_check
def _last(image, size, weight, bias, out, slope):
    """Write the leaky ReLU of the 3×3 convolution of an image to `out`."""
    taps = np.ascontiguousarray(weight.transpose(2, 3, 1, 0)).reshape(9, CHANNELS, CHANNELS)
    _convolve(image, size, size, taps, _kernel_offsets(size + 2), bias, out, 0, 1, 1)
    _activate(out, len(out) // ((size + 2) ** 2 * CHANNELS), size, slope)


@njit(error_model="numpy")
@no_type_check
def _last_backward(image, size, weight, upstream, out):
    """Write the gradient in `image` to `out`; return that in the weight."""
    taps = np.ascontiguousarray(weight.transpose(2, 3, 1, 0)).reshape(9, CHANNELS, CHANNELS)
    offsets, gradient = _kernel_offsets(size + 2), np.zeros_like(taps)
    for tap in range(9):
        _correlate(image, upstream, size, 1, offsets[tap], 0, gradient[tap])
    _convolve(upstream, size, size, _transposed(taps), -offsets, _NOTHING, out, 0, 1, 1)
    return gradient.reshape(3, 3, CHANNELS, CHANNELS).transpose(3, 2, 0, 1).copy()


@njit(error_model="numpy")
@no_type_check
def _read(image, size, pixels, shares, weight, bias, out):
    """Write to `out` (b, k, 3) what vertices read bilinearly from an image, through the last 1×1 convolution."""
    side, mixed = size + 2, np.empty(CHANNELS, np.float32)
    for b in range(len(out)):
        for i in range(len(pixels)):
            mixed[:] = 0
            for corner in range(4):
                at = _position(b, pixels[i, corner], size, side)
                for c in range(CHANNELS):
                    mixed[c] += image[at + c] * shares[i, corner]
            for axis in range(3):
                total = bias[axis]
                for c in range(CHANNELS):
                    total += mixed[c] * weight[axis, c]
                out[b, i, axis] = total


@njit(error_model="numpy")
@no_type_check
def _read_backward(image, size, pixels, shares, weight, upstream, out):
    """Write the gradient in the image to `out`; return those in the 1×1 convolution's weight and bias."""
    side, mixed, sent = size + 2, np.empty(CHANNELS, np.float32), np.empty(CHANNELS, np.float32)
    gradient, bias = np.zeros((3, CHANNELS), np.float32), np.zeros(3, np.float32)
    out[:] = 0
    for b in range(len(upstream)):
        for i in range(len(pixels)):
            mixed[:] = 0
            sent[:] = 0
            for axis in range(3):
                for c in range(CHANNELS):
                    sent[c] += weight[axis, c] * upstream[b, i, axis]
            for corner in range(4):
                at, share = _position(b, pixels[i, corner], size, side), shares[i, corner]
                for c in range(CHANNELS):
                    mixed[c] += image[at + c] * share
                    out[at + c] += sent[c] * share
            for axis in range(3):
                bias[axis] += upstream[b, i, axis]
                for c in range(CHANNELS):
                    gradient[axis, c] += mixed[c] * upstream[b, i, axis]
    return gradient, bias


@njit(inline="always", error_model="numpy")
@no_type_check
def _position(b, pixel, size, side):
    return ((b * side + pixel // size + 1) * side + pixel % size + 1) * CHANNELS


class MapOffsets(torch.autograd.Function):
    """apply(start, slope, pixels, shares, *weights) → offsets (b, k, 3), before any scaling.

    start: (b, 8, 8, c ≤ 16). pixels, shares: of a `deformation_map.Bilinear`.
    weights: weight (16, c, 3, 3) and bias of each upsampling level, of the 3×3 convolution after them, and weight
    (3, 16) and bias of the last.
    """

    @staticmethod
    def forward(ctx, start, slope, pixels, shares, *weights):
        arrays = [array.detach().contiguous().numpy() for array in weights]
        batch, s = start.shape[:2]
        images = [_take(batch, s)]
        _place(start.detach().contiguous().numpy(), images[0])
        for level in range(0, len(arrays) - 4, 2):
            images.append(_take(batch, 2 * s))
            _upsample(images[-2], s, arrays[level], arrays[level + 1], images[-1], np.float32(slope))
            s *= 2
        images.append(_take(batch, s))
        _last(images[-2], s, arrays[-4], arrays[-3], images[-1], np.float32(slope))
        out = np.empty((batch, len(pixels), 3), np.float32)
        _read(images[-1], s, pixels.numpy(), shares.numpy(), arrays[-2], arrays[-1], out)
        if any(ctx.needs_input_grad):
            ctx.images, ctx.arrays, ctx.slope, ctx.size = images, arrays, np.float32(slope), s
            ctx.grid, ctx.start_shape = (pixels.numpy(), shares.numpy()), start.shape
        else:
            _give(*images)
        return torch.from_numpy(out)

    @staticmethod
    def backward(ctx, upstream):
        images, arrays, slope, s = ctx.images, ctx.arrays, ctx.slope, ctx.size
        batch, first, _, channels = ctx.start_shape
        gradients = [None] * len(arrays)
        below, here = _take(batch, s), _take(batch, s)
        sent = upstream.contiguous().numpy()
        gradients[-2:] = _read_backward(images[-1], s, *ctx.grid, arrays[-2], sent, here)
        gradients[-3] = _deactivate(here, images[-1], batch, s, slope)
        gradients[-4] = _last_backward(images[-2], s, arrays[-4], here, below)
        _give(here)
        for level in range(len(arrays) - 6, -1, -2):
            here, s = below, s // 2
            gradients[level + 1] = _deactivate(here, images[level // 2 + 1], batch, 2 * s, slope)
            below = _take(batch, s)
            gradients[level] = _upsample_backward(images[level // 2], s, arrays[level], here, below)
            _give(here)
        start = below.reshape(batch, first + 2, first + 2, CHANNELS)[:, 1:-1, 1:-1, :channels].copy()
        _give(below, *images)
        ctx.images = None
        return torch.from_numpy(start), None, None, None, *map(torch.from_numpy, gradients)
