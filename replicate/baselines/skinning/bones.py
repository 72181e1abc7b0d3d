"""The bone step of SSDR: with the weights fixed, find every bone's rigid motion in every pose (Le & Deng 2012, §5).

A pose's displacements are D = Σ_b w_b (p M_b), p = (u, 1) the homogeneous rest point and M_b = [R_b − I; t_b] 4 × 3.
Transposed motions are stored as `motion` (f, 3, B, 4): pose, coordinate, bone, component of p. With the weights fixed
the squared error is quadratic in them, and all it needs of n vertices are the matrices

    UU = Σ_i z_i z_iᵀ   (4B, 4B)       VU = Σ_i x_i z_iᵀ   (f, 3, 4B),      z_i = w_i ⊗ p_i,  x_i the displacement,

so a sweep costs the same for a thousand vertices as for a million. Poses are independent. In one pose the bones are
taken in turn, each by a weighted Procrustes problem with the others fixed: Gauss–Seidel.
"""

from typing import no_type_check

import numpy as np
from jaxtyping import Float
from numba import njit

from replicate.base.jit_cache import kept
from replicate.geometry.alignment import nearest_rotation

# Pulls an undetermined rotation (of a bone with one vertex, or with vertices on a line) to where it was. The pull
# follows the bone, so it changes no fixed point.
STAY = 1e-9


def weighted_points(
    points: Float[np.ndarray, "n 4"], dense_weights: Float[np.ndarray, "n bones"]
) -> Float[np.ndarray, "n 4*bones"]:
    """Return z_i = w_i ⊗ p_i for every vertex."""
    return (dense_weights[:, :, None] * points[:, None, :]).reshape(len(points), -1)


def sweep_reference(
    motion: Float[np.ndarray, "f 3 bones 4"], uu: Float[np.ndarray, "k k"], vu: Float[np.ndarray, "f 3 k"]
) -> Float[np.ndarray, "f 3 bones 4"]:
    """Return the motions after one Gauss–Seidel sweep over the bones; the reference for `sweep`."""
    frames, _, bones, _ = motion.shape
    motion = motion.copy()
    blocks = uu.reshape(bones, 4, bones, 4)
    for b in range(bones):
        mass = blocks[b, 3, b, 3]
        if mass < _empty(uu):
            continue
        others = np.einsum("pcq,fkcq->fpk", blocks[b], motion)
        others -= np.einsum("pq,fkq->fpk", blocks[b, :, b], motion[:, :, b])
        target = vu.reshape(frames, 3, bones, 4)[:, :, b].swapaxes(1, 2) - others  # (f, 4, 3)
        moment = blocks[b, :3, b, 3]
        inertia = blocks[b, :3, b, :3] - np.outer(moment, moment) / mass
        covariance = target[:, :3] - moment[:, None] * target[:, 3:] / mass + inertia
        before = motion[:, :, b, :3].swapaxes(1, 2) + np.eye(3)
        turn = nearest_rotation(covariance + STAY * mass * before) - np.eye(3)
        motion[:, :, b, :3] = turn.swapaxes(1, 2)
        motion[:, :, b, 3] = (target[:, 3] - moment @ turn) / mass
    return motion


def sweep(
    motion: Float[np.ndarray, "f 3 bones 4"],
    uu: Float[np.ndarray, "k k"],
    vu: Float[np.ndarray, "f 3 k"],
    sweeps: int,
    tolerance: float = 0.0,
) -> Float[np.ndarray, "f 3 bones 4"]:
    """Return the motions after up to `sweeps` Gauss–Seidel sweeps.

    motion: where to start.
    uu, vu: UU and VU of the weights, as above.
    sweeps: how many at most.
    tolerance: a pose ends once a sweep moves no entry of its motions by more (radians and rest radii).
    """
    result = np.ascontiguousarray(motion, np.float64).copy()
    frames, _, bones, _ = result.shape
    _sweep(result.reshape(frames, 3, 4 * bones), np.ascontiguousarray(uu), np.ascontiguousarray(vu), sweeps, tolerance)
    return result


def project(motion: Float[np.ndarray, "f 3 bones 4"]) -> Float[np.ndarray, "f 3 bones 4"]:
    """Return motions whose linear parts are the rotations nearest to those of `motion`."""
    result = np.ascontiguousarray(motion, np.float64).copy()
    _project(result)
    return result


def _empty(uu: np.ndarray) -> float:
    """Return the Σ w² below which a bone's vertices don't determine its motion."""
    return 1e-12 * np.trace(uu)


@kept
@njit(fastmath={"reassoc", "contract", "nsz"})
@no_type_check
def _sweep(motion, uu, vu, sweeps, tolerance):
    frames, _, width = motion.shape
    bones = width // 4
    empty = 1e-12 * np.trace(uu)
    target = np.empty((4, 3))
    covariance = np.empty((3, 3))
    inertia = np.empty((bones, 3, 3))
    # the bones' inertia about their centres, the same in all poses
    for b in range(bones):
        o = 4 * b
        mass = max(uu[o + 3, o + 3], empty)
        for p in range(3):
            for q in range(3):
                inertia[b, p, q] = uu[o + p, o + q] - uu[o + p, o + 3] * uu[o + q, o + 3] / mass
    # each pose until its bones rest
    for f in range(frames):
        for _ in range(sweeps):
            change = 0.0
            for b in range(bones):
                o = 4 * b
                mass = uu[o + 3, o + 3]
                if mass < empty:
                    continue
                # what the other bones leave to this one
                for p in range(4):
                    row = uu[o + p]
                    for k in range(3):
                        total = 0.0
                        for j in range(width):
                            total += row[j] * motion[f, k, j]
                        for j in range(4):
                            total -= row[o + j] * motion[f, k, o + j]
                        target[p, k] = vu[f, k, o + p] - total
                for p in range(3):
                    for k in range(3):
                        stay = STAY * mass * (motion[f, k, o + p] + (1.0 if p == k else 0.0))
                        drift = uu[o + p, o + 3] * target[3, k] / mass
                        covariance[p, k] = target[p, k] - drift + inertia[b, p, k] + stay
                # its best rotation, and the translation that goes with it
                turn = rotation_of(covariance)
                for k in range(3):
                    shift = target[3, k]
                    for p in range(3):
                        entry = turn[p, k] - (1.0 if p == k else 0.0)
                        change = max(change, abs(entry - motion[f, k, o + p]))
                        motion[f, k, o + p] = entry
                        shift -= uu[o + p, o + 3] * entry
                    shift /= mass
                    change = max(change, abs(shift - motion[f, k, o + 3]))
                    motion[f, k, o + 3] = shift
            if change <= tolerance:
                break


@kept
@njit
@no_type_check
def _project(motion):
    frames, _, bones, _ = motion.shape
    matrix = np.empty((3, 3))
    for f in range(frames):
        for b in range(bones):
            for p in range(3):
                for k in range(3):
                    matrix[p, k] = motion[f, k, b, p] + (1.0 if p == k else 0.0)
            turn = rotation_of(matrix)
            for p in range(3):
                for k in range(3):
                    motion[f, k, b, p] = turn[p, k] - (1.0 if p == k else 0.0)


@kept
@njit
@no_type_check
def rotation_of(matrix: np.ndarray) -> np.ndarray:
    """Return the R in SO(3) that maximises tr(Rᵀ matrix), by Horn's quaternion, so that it is never a reflection.

    The quaternion is the top eigenvector of a symmetric 4 × 4 matrix, by Jacobi's rotations.
    """
    # Horn's matrix of the matrix at unit size
    key = np.empty((4, 4))
    vectors = np.eye(4)
    size = 0.0
    for p in range(3):
        for k in range(3):
            size = max(size, abs(matrix[p, k]))
    if size == 0.0:
        return np.eye(3)
    s = matrix / size
    key[0, 0] = s[0, 0] + s[1, 1] + s[2, 2]
    key[1, 1] = s[0, 0] - s[1, 1] - s[2, 2]
    key[2, 2] = s[1, 1] - s[0, 0] - s[2, 2]
    key[3, 3] = s[2, 2] - s[0, 0] - s[1, 1]
    key[0, 1] = key[1, 0] = s[1, 2] - s[2, 1]
    key[0, 2] = key[2, 0] = s[2, 0] - s[0, 2]
    key[0, 3] = key[3, 0] = s[0, 1] - s[1, 0]
    key[1, 2] = key[2, 1] = s[0, 1] + s[1, 0]
    key[1, 3] = key[3, 1] = s[0, 2] + s[2, 0]
    key[2, 3] = key[3, 2] = s[1, 2] + s[2, 1]
    # Jacobi's rotations make it diagonal
    for _ in range(12):
        off = 0.0
        for p in range(3):
            for q in range(p + 1, 4):
                off += key[p, q] * key[p, q]
        if off < 1e-30:
            break
        for p in range(3):
            for q in range(p + 1, 4):
                if key[p, q] == 0.0:
                    continue
                ratio = (key[q, q] - key[p, p]) / (2.0 * key[p, q])
                t = 1.0 / (abs(ratio) + np.sqrt(ratio * ratio + 1.0))
                if ratio < 0.0:
                    t = -t
                c = 1.0 / np.sqrt(t * t + 1.0)
                d = t * c
                for j in range(4):
                    a, e = key[j, p], key[j, q]
                    key[j, p], key[j, q] = c * a - d * e, d * a + c * e
                for j in range(4):
                    a, e = key[p, j], key[q, j]
                    key[p, j], key[q, j] = c * a - d * e, d * a + c * e
                for j in range(4):
                    a, e = vectors[j, p], vectors[j, q]
                    vectors[j, p], vectors[j, q] = c * a - d * e, d * a + c * e
    # the eigenvector of the largest eigenvalue, as a rotation
    top = 0
    for p in range(1, 4):
        if key[p, p] > key[top, top]:
            top = p
    w, x, y, z = vectors[0, top], vectors[1, top], vectors[2, top], vectors[3, top]
    norm = 1.0 / np.sqrt(w * w + x * x + y * y + z * z)
    w, x, y, z = w * norm, x * norm, y * norm, z * norm
    turn = np.empty((3, 3))
    turn[0, 0], turn[1, 1], turn[2, 2] = 1 - 2 * (y * y + z * z), 1 - 2 * (x * x + z * z), 1 - 2 * (x * x + y * y)
    turn[0, 1], turn[1, 0] = 2 * (x * y + w * z), 2 * (x * y - w * z)
    turn[0, 2], turn[2, 0] = 2 * (x * z - w * y), 2 * (x * z + w * y)
    turn[1, 2], turn[2, 1] = 2 * (y * z + w * x), 2 * (y * z - w * x)
    return turn
