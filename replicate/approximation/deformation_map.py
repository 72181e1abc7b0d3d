"""Deformation maps I_k: images over a segment's chart, sampled at its texture coordinates (§3.1, Fig. 2).

Pixel (row r, column c) of a map of `size`×`size` pixels sits at u = c / (size − 1), v = r / (size − 1): the outermost
pixels lie on the border of the chart, so that no vertex is extrapolated. Maps have their channels last.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Float, Float32, Int

if TYPE_CHECKING:  # posing a face doesn't need it, and it is slow to load
    from scipy.sparse import csr_array

# Weight of |I|² beside |data|² in the least-squares fit: it only decides pixels that no vertex reads, and moves the
# result by less than a thousandth of the offsets.
RIDGE = 1e-6


@dataclass(frozen=True)
class Bilinear:
    """How k vertices read a map: the four pixels around each, and their weights.

    pixels: (k, 4) int32, index r·size + c.
    weights: (k, 4) float32, non-negative; each row sums to 1.
    """

    size: int
    pixels: np.ndarray
    weights: np.ndarray


def bilinear(uv: Float[np.ndarray, "k 2"], size: int) -> Bilinear:
    """Return where texture coordinates in [0, 1] lie between the pixels of a map (the U_k of Δ_k = g(I_k; U_k))."""
    place = np.asarray(uv, np.float64) * (size - 1)
    corner = np.clip(np.floor(place).astype(np.int64), 0, size - 2)  # (k, 2): column, row
    (a, b), (column, row) = (place - corner).T, corner.T
    first = row * size + column
    pixels = np.stack([first, first + 1, first + size, first + size + 1], axis=1)
    weights = np.stack([(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b], axis=1)
    return Bilinear(size, pixels.astype(np.int32), weights.astype(np.float32))


def sample(
    maps: Float[torch.Tensor, "b size size c"], pixels: Int[torch.Tensor, "k 4"], weights: Float[torch.Tensor, "k 4"]
) -> Float[torch.Tensor, "b k c"]:
    """Return what each vertex reads from the maps, Δ_k = g(I_k; U_k), in plain torch."""
    read = maps.flatten(1, 2)[:, pixels.long()]  # (b, k, 4, c)
    return (read * weights[:, :, None]).sum(2)


def sampling_matrix(grid: Bilinear) -> "csr_array":
    """Return bilinear sampling as a sparse (k, size²) matrix of float64."""
    from scipy.sparse import csr_array

    rows = np.repeat(np.arange(len(grid.pixels)), 4)
    entries = grid.weights.ravel().astype(np.float64)
    return csr_array((entries, (rows, grid.pixels.ravel())), shape=(len(grid.pixels), grid.size**2))


def polyharmonic_map(
    uv: Float[np.ndarray, "k 2"], values: Float[np.ndarray, "k d"], size: int
) -> Float[np.ndarray, "size size d"]:
    """Interpolate vertex values to the pixels of a map: polyharmonic interpolation with a linear kernel (§3.3).

    uv: texture coordinates; vertices with the same ones are averaged, since no function can pass through both values.
    values: d of them for each vertex.

    An affine function of u and v is added to the kernels, as is usual, so that affine maps are kept.
    """
    from scipy.interpolate import RBFInterpolator
    from scipy.sparse import csr_array

    places, inverse = np.unique(np.asarray(uv, np.float64), axis=0, return_inverse=True)
    inverse = inverse.ravel()
    share = csr_array((np.ones(len(inverse)), (inverse, np.arange(len(inverse)))), shape=(len(places), len(inverse)))
    means = (share @ np.asarray(values, np.float64)) / np.bincount(inverse)[:, None]
    spread = np.linalg.matrix_rank(places - places.mean(0), tol=1e-6)
    degree = 1 if spread == 2 else 0  # three places on a line determine no affine function
    ticks = np.linspace(0, 1, size)
    column, row = np.meshgrid(ticks, ticks)
    targets = np.stack([column.ravel(), row.ravel()], axis=1)
    return RBFInterpolator(places, means, kernel="linear", degree=degree)(targets).reshape(size, size, -1)


class Projection:
    """The least-squares maps of a segment, min_I Σ |g(I; U) − values|² + RIDGE |I|², for any number of poses."""

    def __init__(self, uv: Float[np.ndarray, "k 2"], size: int):
        from scipy.sparse import identity
        from scipy.sparse.linalg import splu

        self.matrix = sampling_matrix(bilinear(uv, size))
        normal = self.matrix.T @ self.matrix + RIDGE * identity(size**2)
        self.factor = splu(normal.tocsc())

    def __call__(self, offsets: Float[np.ndarray, "b k 3"]) -> Float32[np.ndarray, "b k 3"]:
        """Return the offsets that the segment's vertices read from the least-squares maps."""
        b, k, _ = offsets.shape
        columns = np.asarray(offsets, np.float64).transpose(1, 0, 2).reshape(k, 3 * b)
        fit = self.matrix @ self.factor.solve(self.matrix.T @ columns)
        return fit.reshape(k, b, 3).transpose(1, 0, 2).astype(np.float32)


class Floor:
    """The true offsets as well as maps of these sizes can hold them, by least squares.

    segments: the coarse ones, each with `.vertices` (k,) and `.uv` (k, 2).
    size: that of the coarse maps.
    refinement: segments whose maps, of `refinement_size`, hold a part of the remaining residual.
    """

    def __init__(self, segments: Sequence, size: int, refinement: Sequence = (), refinement_size: int = 64):
        levels = ((segments, size), (refinement, refinement_size))
        self.projections = [(s.vertices, Projection(s.uv, width)) for level, width in levels for s in level]

    def __call__(self, offsets: Float[np.ndarray, "b n 3"]) -> Float32[np.ndarray, "b n 3"]:
        """Return the offsets (mm) that the vertices read from the maps; zero on vertices outside the segments."""
        floor = np.zeros(offsets.shape, np.float32)
        for vertices, project in self.projections:
            floor[:, vertices] += project(offsets[:, vertices] - floor[:, vertices])
        return floor
