"""Mesh segments that move rigidly, and their placement by other vertices (§3.4).

Teeth need no network: once the deformable part of a mesh is approximated, each tooth follows the rotation and
translation of a few deformable vertices that move as it does. Example poses show which segments are rigid (Eq. 3) and
which vertices carry them (Eq. 4). What moves rigidly need not follow anything: an eyeball that turns in still skin has
no vertex to carry it. So a segment that its vertices would misplace is approximated like any other (DEVIATIONS D15).
All lengths are millimetres; rotations act on row vectors, V @ R + t.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int

from replicate.base.exceptions import InputError
from replicate.geometry.alignment import align
from replicate.geometry.mesh import Mesh

CHUNK = 256  # poses at a time


@runtime_checkable
class Poses(Protocol):
    """Vertices (b, n, 3) of many poses, mm: an array, or anything else that gives some poses at a time."""

    def __len__(self) -> int: ...

    def __getitem__(self, rows: slice, /) -> Float[np.ndarray, "k n 3"]: ...


def chunks(poses: Poses) -> Iterator[Float[np.ndarray, "k n 3"]]:
    """Yield all poses, some at a time."""
    for start in range(0, len(poses), CHUNK):
        yield poses[start : start + CHUNK]


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


def mean_segment_errors(mesh: Mesh, poses: Poses) -> Float[np.ndarray, " k"]:
    """Return the mean of `segment_errors` over poses."""
    return np.sum([segment_errors(mesh, part).sum(0) for part in chunks(poses)], axis=0) / len(poses)


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
    mesh: Mesh, poses: Poses, tau_mm: float = 0.3, count: int = 10, named: Collection[int] = ()
) -> Attachments:
    """Find the rigid segments (mean of Eq. 3 below τ), and for each the `count` vertices that follow it best (Eq. 4).

    poses: example poses of the rig.
    named: segments that are rigid whatever Eq. 3 says.

    Raises InputError if there are rigid segments but fewer deformable vertices than `count`.
    """
    errors = mean_segment_errors(mesh, poses)
    rigid = np.union1d(np.flatnonzero(errors < tau_mm), np.array(list(named), np.int64))
    candidates = np.flatnonzero(~np.isin(mesh.segment, rigid))
    if len(rigid) and len(candidates) < count:
        raise InputError(
            f"rigid segments: expected at least {count} deformable vertices to carry {len(rigid)} rigid segments, "
            f"got {len(candidates)}"
        )
    follow = following_errors(mesh, candidates, rigid, poses)
    best = np.argsort(follow, axis=1, kind="stable")[:, :count]
    carriers = candidates[best]
    spread = np.empty((len(rigid), 3))
    for row, vertices in enumerate(carriers):
        variance = np.linalg.eigvalsh(np.cov(mesh.neutral[vertices].astype(np.float64).T, bias=True))[::-1]
        spread[row] = np.sqrt(np.maximum(variance, 0.0))
    return Attachments(rigid, carriers, np.take_along_axis(follow, best, 1), errors[rigid], spread)


def following_errors(
    mesh: Mesh, candidates: Int[np.ndarray, " v"], rigid: Int[np.ndarray, " r"], poses: Poses
) -> Float[np.ndarray, "r v"]:
    """Return how badly each candidate follows each rigid segment, √ε_rj of Eq. 4, in millimetres.

    The square is multiplied out, so that poses can be summed first: with p = (v⁰, 1), A = [R − I; t] and x = v − v⁰,
    Σ_i ‖p A_i − x_i‖² = p (Σ A_i A_iᵀ) pᵀ − 2 p Σ A_i x_i + Σ ‖x_i‖².
    """
    neutral = mesh.neutral[candidates].astype(np.float64)
    p = np.concatenate([neutral, np.ones((len(neutral), 1))], axis=1)  # (v, 4)
    total = np.zeros((len(rigid), len(candidates)))
    for part in chunks(poses) if len(rigid) else ():
        x = (part[:, candidates] - neutral).transpose(1, 0, 2).reshape(len(neutral), -1)  # (v, 3 b)
        square = (x**2).sum(1)
        for row, k in enumerate(rigid):
            rotation, translation = align(mesh.neutral[mesh.segment == k], part[:, mesh.segment == k])
            motion = np.concatenate([rotation - np.eye(3), translation[:, None]], axis=1)  # (b, 4, 3)
            motion = motion.transpose(0, 2, 1).reshape(-1, 4)
            total[row] += (p @ (motion.T @ motion) * p).sum(1) + square - 2 * ((x @ motion) * p).sum(1)
    return np.sqrt(np.maximum(total, 0.0) / len(poses))


def placement_errors(mesh: Mesh, attachments: Attachments, poses: Poses) -> Float[np.ndarray, " r"]:
    """Return how far each rigid segment is from its place when its vertices carry it, in millimetres.

    It is a mean over poses of the root mean square over vertices: over all poses, or over those that move the segment
    by more than that, whichever is larger. A segment that seldom moves could not be judged by the first alone.
    """
    if not len(attachments.segment):
        return np.empty(0)
    errors, moved = (np.concatenate(part) for part in zip(*_placed(mesh, attachments, poses), strict=True))
    everywhere = errors.mean(0)
    moves = moved > everywhere
    where_moved = np.where(moves, errors, 0.0).sum(0) / np.maximum(moves.sum(0), 1)
    return np.maximum(everywhere, where_moved)


def _placed(mesh: Mesh, attachments: Attachments, poses: Poses) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield how far segments are from their places, and from where they rest, (k, r) each, some poses at a time."""
    rms = lambda difference: np.sqrt((difference.astype(np.float64) ** 2).sum(-1).mean(-1))  # noqa: E731
    members = [np.flatnonzero(mesh.segment == k) for k in attachments.segment]
    for part in chunks(poses):
        placed = attach(mesh, attachments, part)
        error = [rms(placed[:, own] - part[:, own]) for own in members]
        motion = [rms(part[:, own] - mesh.neutral[own]) for own in members]
        yield np.stack(error, 1), np.stack(motion, 1)


def without(attachments: Attachments, segments: Collection[int]) -> Attachments:
    """Return the attachments of all rigid segments but some."""
    kept = ~np.isin(attachments.segment, list(segments))
    return Attachments(**{name: array[kept] for name, array in vars(attachments).items()})


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
