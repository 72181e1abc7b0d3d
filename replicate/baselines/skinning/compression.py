"""Poses of a mesh compressed for SSDR: a canonical order, unit size, and a low-rank factorisation.

Faces have far fewer ways to move than poses times coordinates. D ≈ Q Y, with Q (3f, r) orthonormal, gives the
displacements to a stated tolerance, and every inner product that the fit needs follows from Q and Y.
"""

import hashlib
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array, diags_array, eye_array
from scipy.sparse.linalg import splu

TOLERANCE = 1e-5  # of the RMS displacement
FIRST_RANK, LARGEST_RANK = 192, 384  # a skin of fewer than 96 bones has a rank below the latter


@dataclass(frozen=True)
class CompressedPoses:
    """Displacements of n vertices in f poses, in units of the mesh's RMS radius, about its centre.

    points: (n, 4) float64, homogeneous rest points p = (u, 1).
    basis: Q (3f, r) float64, orthonormal; row 3f' + k is coordinate k of pose f'.
    coefficients: Y (r, n) float64.
    centre_mm, radius_mm: (3,) and a number, which undo the scaling.
    lost: the share of the RMS displacement that QY leaves out.
    """

    points: Float[np.ndarray, "n 4"]
    basis: Float[np.ndarray, "poses3 r"]
    coefficients: Float[np.ndarray, "r n"]
    centre_mm: Float[np.ndarray, "3"]
    radius_mm: float
    lost: float

    @property
    def frames(self) -> int:
        return len(self.basis) // 3


def canonical_order(
    neutral: Float[np.ndarray, "n 3"], vertices: Float[np.ndarray, "f n 3"]
) -> tuple[Int[np.ndarray, "n"], Int[np.ndarray, "f"]]:
    """Return orders of vertices and poses that depend on their contents alone.

    Fitting in these orders makes the result indifferent, to the last bit, to how a file happened to be sorted.
    Vertices are sorted by rest position (where two coincide, by the box they move in), poses by a hash of their bytes,
    so that any run of them is a fair sample.
    """
    keys = np.concatenate([neutral, vertices.min(0), vertices.max(0)], axis=1)
    vertex_order = np.lexsort(keys.T[::-1])
    digests = [hashlib.blake2b(pose[vertex_order].tobytes(), digest_size=16).digest() for pose in vertices]
    return vertex_order, np.array(sorted(range(len(digests)), key=digests.__getitem__))


def scaled_displacements(
    neutral: Float[np.ndarray, "n 3"], vertices: Float[np.ndarray, "f n 3"], radius_mm: float
) -> Float[np.ndarray, "poses3 n"]:
    """Return (V − V⁰) / radius as a matrix (3f, n) of float32."""
    offsets = (vertices - neutral) * np.float32(1.0 / radius_mm)
    return np.ascontiguousarray(offsets.transpose(0, 2, 1), np.float32).reshape(-1, len(neutral))


def rest_frame(neutral: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, "n 4"], Float[np.ndarray, "3"], float]:
    """Return homogeneous rest points about the mesh's centre in units of its RMS radius, the centre and the radius."""
    rest = neutral.astype(np.float64)
    centre = rest.mean(0)
    radius = float(np.sqrt(((rest - centre) ** 2).sum(1).mean())) or 1.0
    return np.concatenate([(rest - centre) / radius, np.ones((len(rest), 1))], axis=1), centre, radius


def compress(
    neutral: Float[np.ndarray, "n 3"], vertices: Float[np.ndarray, "f n 3"], generator: np.random.Generator
) -> CompressedPoses:
    """Return the poses in compressed form, by a randomised range finder with one power step (Halko et al. 2011).

    The rank is doubled until what is left out is below TOLERANCE of the RMS displacement, or LARGEST_RANK is reached.
    """
    points, centre, radius = rest_frame(neutral)
    displacements = scaled_displacements(neutral, vertices, radius)
    total = sum(float(np.sum(row.astype(np.float64) ** 2)) for row in displacements)
    limit = min(displacements.shape)
    rank = min(FIRST_RANK, limit)
    while True:
        sketch = generator.standard_normal((displacements.shape[1], rank), dtype=np.float32)
        basis, _ = np.linalg.qr(displacements @ sketch)
        back, _ = np.linalg.qr(displacements.T @ basis)
        basis, _ = np.linalg.qr((displacements @ back).astype(np.float64))
        coefficients = _project_onto(basis, displacements)
        left_out = max(total - float(np.sum(coefficients**2)), 0.0)
        if left_out <= TOLERANCE**2 * total or rank >= min(limit, LARGEST_RANK):
            break
        rank = min(2 * rank, limit, LARGEST_RANK)
    values, directions = np.linalg.eigh(coefficients @ coefficients.T)
    tail = np.cumsum(np.maximum(values, 0.0)) + left_out
    directions = directions[:, tail > TOLERANCE**2 * total] if total > 0 else directions[:, -1:]
    basis, _ = np.linalg.qr(basis @ directions)
    coefficients = _project_onto(basis, displacements)
    lost = np.sqrt(max(total - float(np.sum(coefficients**2)), 0.0) / total) if total > 0 else 0.0
    return CompressedPoses(points, basis, coefficients, centre, radius, float(lost))


def _project_onto(basis: np.ndarray, displacements: np.ndarray, columns: int = 2048) -> np.ndarray:
    """Return Qᵀ D in float64, by blocks of vertices."""
    result = np.empty((basis.shape[1], displacements.shape[1]))
    for start in range(0, displacements.shape[1], columns):
        result[:, start : start + columns] = basis.T @ displacements[:, start : start + columns].astype(np.float64)
    return result


# The metric in which SSDR's errors are measured: distance, and how it changes along mesh edges.


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
    """Return sets of vertices, no two of a set on one edge: each vertex joins the first set that has no neighbour."""
    colours = np.full(edges.shape[0], -1)
    for i in range(len(colours)):
        others = set(colours[edges.indices[edges.indptr[i] : edges.indptr[i + 1]]])
        colours[i] = next(c for c in range(len(others) + 1) if c not in others)
    return tuple(np.flatnonzero(colours == c) for c in range(colours.max() + 1))


def diffuse(edges: csr_array, values: Float[np.ndarray, "n k"], time: float) -> Float[np.ndarray, "n k"]:
    """Return values spread by heat flow over about √time edges: (I + time · L)⁻¹ values."""
    laplacian = diags_array(edges.sum(axis=1)) - edges
    return splu((eye_array(len(values)) + time * laplacian).tocsc()).solve(values)


def _symmetric(pairs: np.ndarray, values: np.ndarray, n: int) -> csr_array:
    first, second = pairs.T
    places = np.concatenate([first, second]), np.concatenate([second, first])
    return csr_array((np.concatenate([values, values]), places), shape=(n, n))
