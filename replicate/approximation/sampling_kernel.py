"""Bilinear sampling of feature maps on the CPU, with its gradient: the fast twin of `deformation_map.sample`.

A vertex reads four pixels, each a run of `c` channels that lie side by side in memory; the inner loops go along them.
"""

from typing import no_type_check

import numba
import torch
from jaxtyping import Float, Int


@numba.njit(error_model="numpy")
@no_type_check
def _read(maps, pixels, weights, out):
    channels = maps.shape[2]
    for b in range(maps.shape[0]):
        for i in range(len(pixels)):
            p0, p1, p2, p3 = pixels[i, 0], pixels[i, 1], pixels[i, 2], pixels[i, 3]
            w0, w1, w2, w3 = weights[i, 0], weights[i, 1], weights[i, 2], weights[i, 3]
            for c in range(channels):
                out[b, i, c] = (maps[b, p0, c] * w0 + maps[b, p1, c] * w1) + (maps[b, p2, c] * w2 + maps[b, p3, c] * w3)


@numba.njit(error_model="numpy")
@no_type_check
def _spread(upstream, pixels, weights, out):
    channels = out.shape[2]
    for b in range(out.shape[0]):
        for i in range(len(pixels)):
            for corner in range(4):
                pixel, weight = pixels[i, corner], weights[i, corner]
                for c in range(channels):
                    out[b, pixel, c] += upstream[b, i, c] * weight


class _Sample(torch.autograd.Function):
    @staticmethod
    def forward(ctx, maps, pixels, weights):
        flat = maps.detach().contiguous().flatten(1, 2)  # (b, size², c)
        out = torch.empty(len(flat), len(pixels), flat.shape[2])
        _read(flat.numpy(), pixels.numpy(), weights.numpy(), out.numpy())
        ctx.save_for_backward(pixels, weights)
        ctx.shape = maps.shape
        return out

    @staticmethod
    def backward(ctx, upstream):
        pixels, weights = ctx.saved_tensors
        out = torch.zeros(ctx.shape)
        _spread(upstream.contiguous().numpy(), pixels.numpy(), weights.numpy(), out.flatten(1, 2).numpy())
        return out, None, None


def sample(
    maps: Float[torch.Tensor, "b size size c"], pixels: Int[torch.Tensor, "k 4"], weights: Float[torch.Tensor, "k 4"]
) -> Float[torch.Tensor, "b k c"]:
    """Return what each vertex reads from the maps; arguments as in `deformation_map.sample`, on the CPU."""
    return _Sample.apply(maps, pixels, weights)
