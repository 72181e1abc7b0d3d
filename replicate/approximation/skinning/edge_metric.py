"""The metric in which SSDR's errors are measured: distance, and how it changes along mesh edges.

Where neighbours err alike, a surface is shifted and keeps its normals; where they err apart, it is tilted by about the
difference over the edge's length. So next to the sum of squared errors stands that of squared tilts,

    E = Σ_i ‖r_i‖² + coherence · Σ_ij ‖r_i − r_j‖² h² / (ℓ_ij² + h²/16),      h the median edge length,

which is rᵀ K r with a sparse K = I + coherence · L. Le & Deng's SSDR is K = I. Both steps take any K: the bone step
through its normal equations, the weight step one set of mutually unconnected vertices after the other.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array, diags_array, eye_array
from scipy.sparse.linalg import splu


@dataclass(frozen=True)
class Metric:
    """K (n, n), the mesh's edges (n, n) as ones, and sets of vertices that share no edge with one another."""

    matrix: csr_array
    edges: csr_array
    colours: tuple[Int[np.ndarray, " _size"], ...]


def edge_metric(rest: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], coherence: float) -> Metric:
    """Return K for the edges of a mesh; without faces, or with a coherence of 0, it is the identity."""
    n = len(rest)
    pairs = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    pairs = np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0)
    squared = ((rest[pairs[:, 0]] - rest[pairs[:, 1]]) ** 2).sum(1)
    typical = float(np.median(squared)) if len(pairs) else 1.0
    stiffness = coherence * typical / (squared + typical / 16 + np.finfo(float).tiny)
    edges = _symmetric(pairs, np.ones(len(pairs)), n)
    if coherence == 0 or not len(pairs):
        return Metric(eye_array(n, format="csr"), edges, (np.arange(n),))
    links = _symmetric(pairs, stiffness, n)
    matrix = csr_array(diags_array(1.0 + links.sum(axis=1)) - links)
    return Metric(matrix, edges, colour(edges))


def colour(edges: csr_array) -> tuple[Int[np.ndarray, " _size"], ...]:
    """Return sets of vertices, no two of a set on one edge: each vertex takes the first that its neighbours left."""
    colours = np.full(edges.shape[0], -1)
    for i in range(len(colours)):
        others = set(colours[edges.indices[edges.indptr[i] : edges.indptr[i + 1]]])
        colours[i] = next(c for c in range(len(others) + 1) if c not in others)
    return tuple(np.flatnonzero(colours == c) for c in range(colours.max() + 1))


def diffuse(edges: csr_array, values: Float[np.ndarray, "n k"], time: float) -> Float[np.ndarray, "n k"]:
    """Return values after heat flow along the edges, (I + time · L)⁻¹ values; they spread over about √time edges."""
    laplacian = diags_array(edges.sum(axis=1)) - edges
    return splu((eye_array(len(values)) + time * laplacian).tocsc()).solve(values)


def _symmetric(pairs: np.ndarray, values: np.ndarray, n: int) -> csr_array:
    first, second = pairs.T
    places = np.concatenate([first, second]), np.concatenate([second, first])
    return csr_array((np.concatenate([values, values]), places), shape=(n, n))
