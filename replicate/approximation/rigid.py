"""Mesh segments that move rigidly, and their placement by other vertices (§3.4).

Teeth need no network: once the deformable part of a mesh is approximated, each tooth follows the rotation and
translation of a few deformable vertices that move as it does. Example poses show which segments are rigid (Eq. 3) and
which vertices carry them (Eq. 4). All lengths are millimetres; rotations act on row vectors, V @ R + t.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from replicate.base.exceptions import InputError
from replicate.geometry.alignment import align
from replicate.geometry.mesh import Mesh


def segment_errors(mesh: Mesh, vertices: Float[np.ndarray, "b n 3"]) -> Float[np.ndarray, "b k"]:
    """Return how far each segment is from a rigid motion in each pose: Eq. 3's residual as an RMS in millimetres.

    Eq. 3 is a sum of squares over a segment's vertices, which grows with their number, while the paper's threshold is a
    length; so the root of the mean over vertices is taken (DEVIATIONS D15). Columns are in the order of
    `mesh.segment_names`.
    """
    errors = np.empty((len(vertices), len(mesh.segment_names)))
    for k in range(len(mesh.segment_names)):
        rest, posed = mesh.neutral[mesh.segment == k], vertices[:, mesh.segment == k]
        rotation, translation = align(rest, posed)
        residual = rest @ rotation + translation[:, None, :] - posed
        errors[:, k] = np.sqrt((residual**2).sum(-1).mean(-1))
    return errors


@dataclass(frozen=True)
class Attachments:
    """Rigid segments and the deformable vertices that carry them (r segments, c vertices each).

    segment: indices into the mesh's segments.
    vertex: indices into the mesh, best first.
    error_mm: √ε_rj of Eq. 4 for these vertices.
    rigid_error_mm: each segment's mean residual of Eq. 3.
    spread_mm: standard deviations of the carrying vertices at rest along their three principal axes, largest first; if
        the second is small, the placement is badly conditioned.
    """

    segment: Int[np.ndarray, " r"]
    vertex: Int[np.ndarray, "r c"]
    error_mm: Float[np.ndarray, "r c"]
    rigid_error_mm: Float[np.ndarray, " r"]
    spread_mm: Float[np.ndarray, "r 3"]

    def save(self, path: Path) -> None:
        """Write the five arrays as one npz file."""
        np.savez(path, **vars(self))

    @staticmethod
    def load(path: Path) -> "Attachments":
        """Read what `save` wrote."""
        with np.load(path, allow_pickle=False) as arrays:
            return Attachments(**{name: arrays[name] for name in arrays.files})


def find_attachments(
    mesh: Mesh, vertices: Float[np.ndarray, "b n 3"], tau_mm: float = 0.3, count: int = 10
) -> Attachments:
    """Find the rigid segments (mean of Eq. 3 below τ), and for each the `count` vertices that follow it best (Eq. 4).

    vertices: example poses of the rig, mm.

    Raises InputError if there are rigid segments but fewer deformable vertices than `count`.
    """
    errors = segment_errors(mesh, vertices).mean(0)
    rigid = np.flatnonzero(errors < tau_mm)
    candidates = np.flatnonzero(~np.isin(mesh.segment, rigid))
    if len(rigid) and len(candidates) < count:
        raise InputError(
            f"rigid segments: expected at least {count} deformable vertices to carry {len(rigid)} rigid segments, "
            f"got {len(candidates)}"
        )
    rest_around, around = mesh.neutral[candidates], vertices[:, candidates]
    carriers = np.empty((len(rigid), count), np.int64)
    follow = np.empty((len(rigid), count))
    spread = np.empty((len(rigid), 3))
    for row, k in enumerate(rigid):
        motion = align(mesh.neutral[mesh.segment == k], vertices[:, mesh.segment == k])
        error = following_errors(rest_around, around, *motion)
        best = np.argsort(error, kind="stable")[:count]
        carriers[row], follow[row] = candidates[best], error[best]
        rest = mesh.neutral[carriers[row]].astype(np.float64)
        variance = np.linalg.eigvalsh(np.cov(rest.T, bias=True))[::-1]
        spread[row] = np.sqrt(np.maximum(variance, 0.0))
    return Attachments(rigid, carriers, follow, errors[rigid], spread)


def following_errors(
    neutral: Float[np.ndarray, "n 3"],
    vertices: Float[np.ndarray, "b n 3"],
    rotation: Float[np.ndarray, "b 3 3"],
    translation: Float[np.ndarray, "b 3"],
) -> Float[np.ndarray, " n"]:
    """Return how badly each vertex follows a rigid motion, √ε_rj of Eq. 4, in millimetres.

    The square is multiplied out, so that poses can be summed first: with p = (v⁰, 1), A = [R − I; t] and x = v − v⁰,
    Σ_i ‖p A_i − x_i‖² = p (Σ A_i A_iᵀ) pᵀ − 2 p Σ A_i x_i + Σ ‖x_i‖².
    """
    homogeneous = np.concatenate([neutral, np.ones((len(neutral), 1))], axis=1).astype(np.float64)
    motion = np.concatenate([rotation - np.eye(3), translation[:, None, :]], axis=1)  # (b, 4, 3)
    motion = motion.transpose(0, 2, 1).reshape(-1, 4)
    displacement = (vertices.astype(np.float64) - neutral).transpose(1, 0, 2).reshape(len(neutral), -1)
    total = (homogeneous @ (motion.T @ motion) * homogeneous).sum(1)
    total += (displacement**2).sum(1) - 2 * ((displacement @ motion) * homogeneous).sum(1)
    return np.sqrt(np.maximum(total, 0.0) / len(vertices))


def attach(mesh: Mesh, attachments: Attachments, vertices: Float[np.ndarray, "b n 3"]) -> Float[np.ndarray, "b n 3"]:
    """Return the poses with every rigid segment placed by the vertices that carry it (§3.4).

    vertices: mm; those of rigid segments are replaced.
    """
    posed = np.array(vertices, np.float32)
    rotation, translation = align(mesh.neutral[attachments.vertex], vertices[:, attachments.vertex])  # (b, r, 3, 3)
    for row, k in enumerate(attachments.segment):
        members = np.flatnonzero(mesh.segment == k)
        posed[:, members] = mesh.neutral[members] @ rotation[:, row] + translation[:, row, None, :]
    return posed
