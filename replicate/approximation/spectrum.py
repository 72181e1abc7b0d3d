"""Errors by their frequency on the mesh: how much of them lies in the quick waves of its Laplacian (§5, Fig. 10)."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int
from scipy import sparse

from replicate.geometry.mesh import Mesh

FILE = "waves.npz"
WAVES = 256  # the slowest ones; what is left of an error without them is its part of high frequency
LEAST_SHARE = 4  # a small mesh has a wave for every so many vertices
SHIFT = 1e-6  # below all eigenvalues, 1/mm²
PRECISION = 1e-6  # of the frequencies
LEAST_AREA = 1e-6  # share of the mean that counts for a vertex whose faces have no area


@dataclass(frozen=True)
class Waves:
    """The slowest waves of a mesh: eigenvectors of the Laplacian of its parts that deform.

    vertices: (v,) indices of the vertices that they are waves of
    basis: (v, k), one wave a column, slow ones first; orthonormal where each vertex counts with its area
    areas: (v,) of each vertex, mm²
    frequencies: (k,) eigenvalues in 1/mm²: a wave of the length ℓ mm has (2π/ℓ)²
    """

    vertices: Int[np.ndarray, " v"]
    basis: Float32[np.ndarray, "v k"]
    areas: Float64[np.ndarray, " v"]
    frequencies: Float64[np.ndarray, " k"]

    def save(self, file: Path) -> None:
        """Write the waves as npz, without pickle."""
        np.savez(file, vertices=self.vertices, basis=self.basis, areas=self.areas, frequencies=self.frequencies)

    @classmethod
    def load(cls, file: Path) -> "Waves":
        """Read what `save` wrote."""
        with np.load(file, allow_pickle=False) as stored:
            return cls(**{name: stored[name] for name in ("vertices", "basis", "areas", "frequencies")})


def slow_waves(mesh: Mesh, deforming: Bool[np.ndarray, " n"], count: int = WAVES) -> Waves:
    """Return the slowest waves of the parts of a mesh that deform, all parts together.

    deforming: which vertices are no rigid segment's; those without a face between them are left out
    count: of waves; a mesh with fewer than `LEAST_SHARE` vertices for each has fewer
    """
    from scipy.sparse.linalg import LinearOperator, eigsh, splu

    faces = mesh.faces[deforming[mesh.faces].all(1)]
    vertices, corners = np.unique(faces, return_inverse=True)
    stiffness, areas = laplacian(mesh.neutral[vertices].astype(np.float64), corners.reshape(faces.shape))
    few = max(1, min(count, len(vertices) // LEAST_SHARE))
    start = np.random.default_rng(0).normal(size=len(vertices))  # eigsh would draw one, and never the same
    root = sparse.diags(1 / np.sqrt(areas))  # with waves over the roots of areas the problem is a symmetric one
    shifted = (root @ stiffness @ root + SHIFT * sparse.eye(len(vertices))).tocsc()
    solver = splu(shifted, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    inverse = LinearOperator(shifted.shape, matvec=solver.solve, dtype=np.float64)
    keep = min(len(vertices), few + max(20, few // 2))
    inverted, modes = eigsh(inverse, few, which="LM", v0=start, tol=PRECISION, ncv=keep)
    frequencies = np.maximum(1 / inverted - SHIFT, 0.0)
    order = np.argsort(frequencies)
    basis = np.ascontiguousarray((root @ modes)[:, order], np.float32)
    return Waves(vertices, basis, areas, frequencies[order])


def laplacian(
    vertices: Float64[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> tuple[sparse.csr_matrix, Float64[np.ndarray, " v"]]:
    """Return the cotangent Laplacian of a mesh, (v, v), and the area of each vertex: a third of its faces' areas.

    Negative weights, of obtuse pairs of faces, count as 0, so that it has no negative eigenvalues.
    """
    rows, columns, weights = [], [], []
    for k in range(3):
        i, j, apex = faces[:, (k + 1) % 3], faces[:, (k + 2) % 3], faces[:, k]
        a, b = vertices[i] - vertices[apex], vertices[j] - vertices[apex]
        doubled = np.maximum(np.linalg.norm(np.cross(a, b), axis=1), 1e-12)
        rows.append(i)
        columns.append(j)
        weights.append(0.5 * (a * b).sum(1) / doubled)
    size = (len(vertices), len(vertices))
    half = sparse.coo_matrix((np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns))), size)
    joined = (half + half.T).tocsr().maximum(0)
    corners = vertices[faces]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    areas = np.bincount(faces.ravel(), np.repeat(area / 3, 3), len(vertices))
    return (sparse.diags(np.asarray(joined.sum(1)).ravel()) - joined).tocsr(), np.maximum(
        areas, LEAST_AREA * areas.mean()
    )


@dataclass
class Spectrum:
    """Errors of poses, taken apart into waves, as they come in.

    bands: the mean of the squared error over the surface, mm², by octave: of the first wave, the next one, the next
        two, four, …, and last of what no wave has
    """

    waves: Waves
    poses: int = 0
    rough_mm: float = 0.0
    whole_mm: float = 0.0
    bands: np.ndarray = field(init=False)

    def __post_init__(self):
        self.bands = np.zeros(len(octaves(len(self.waves.frequencies))) + 1)

    def add(self, errors: Float[np.ndarray, "b n 3"]) -> None:
        """Add the error vectors of some poses at all vertices of the mesh, in mm."""
        waves = self.waves
        local = np.asarray(errors[:, waves.vertices], np.float64)  # (b, v, 3)
        weights = waves.areas / waves.areas.sum()
        parts = np.einsum("vk,bvc->bkc", waves.basis, local * waves.areas[:, None], optimize=True)
        rough = local - np.einsum("vk,bkc->bvc", waves.basis, parts, optimize=True)
        self.poses += len(local)
        self.rough_mm += float(np.linalg.norm(rough, axis=-1).mean(-1).sum())
        self.whole_mm += float(np.linalg.norm(local, axis=-1).mean(-1).sum())
        energy = (parts**2).sum(-1).sum(0) / waves.areas.sum()  # (k,)
        self.bands[:-1] += [energy[first:last].sum() for first, last in octaves(len(energy))]
        self.bands[-1] += float(((rough**2).sum(-1) @ weights).sum())

    def metrics(self) -> list[tuple[str, str, float]]:
        """Return (metric, unit, value): the mean error of high frequency, its share, and each band's root in mm."""
        values = [("high_frequency_error_mean", "mm", self.rough_mm / self.poses)]
        values.append(("high_frequency_share", "ratio", self.rough_mm / self.whole_mm if self.whole_mm else 0.0))
        roots = np.sqrt(self.bands / self.poses)
        return values + [(f"frequency_band_{k}", "mm", float(root)) for k, root in enumerate(roots)]


def octaves(count: int) -> list[tuple[int, int]]:
    """Return (first, last + 1) of each octave of so many waves: 1, 1, 2, 4, … of them."""
    ends = [1]
    while ends[-1] < count:
        ends.append(min(2 * ends[-1], count))
    return list(zip([0, *ends[:-1]], ends, strict=True))
