"""Linear blend skinning fitted to example poses: SSDR (Le & Deng 2012), the paper's LBS rows in Table 2 (§5.1).

Two steps alternate: sparse convex weights for all vertices with the bones fixed (`weights`), rigid motions of all
bones with the weights fixed (`bones`). Both work on compressed poses and measure errors in `edge_metric`
(`compression`). Bone motions are extrapolated along their last change as long as the error falls (`alternation`). A fit
starts from clusters, and at first every bone may act on every vertex; weights become sparse at the end (`starts`).

An LBS row is an oracle: `refit` sees the very mesh that it then approximates, and no rig parameters.
"""

import hashlib
import json
import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from jaxtyping import Float, Int

from replicate.base.exceptions import InputError
from replicate.base.files import read_sealed, write_sealed
from replicate.baselines.skinning.alternation import State, dense
from replicate.baselines.skinning.bones import sweep, weighted_points
from replicate.baselines.skinning.compression import (
    CompressedPoses,
    canonical_order,
    compress,
    rest_frame,
    scaled_displacements,
)
from replicate.baselines.skinning.starts import alternation


@dataclass(frozen=True)
class Skin:
    """A mesh's bones: n vertices, k influences each.

    neutral: (n, 3) float32 mm. bone_index: (n, k) int32, with no meaning beyond this skin. weights: (n, k) float32,
    non-negative, sum 1; an unused place has weight 0. bones: how many there are.
    """

    neutral: Float[np.ndarray, "n 3"]
    bone_index: Int[np.ndarray, "n k"]
    weights: Float[np.ndarray, "n k"]
    bones: int

    def dense_weights(self) -> Float[np.ndarray, "n bones"]:
        """Return the weights as a matrix of float64, whose rows sum to one."""
        loads = dense(self.bone_index, self.weights.astype(np.float64), self.bones)
        return loads / loads.sum(1, keepdims=True)

    def deform(
        self, rotation: Float[np.ndarray, "b bones 3 3"], translation: Float[np.ndarray, "b bones 3"]
    ) -> Float[np.ndarray, "b n 3"]:
        """Return the skinned vertices Σ_b w_b (v⁰ R_b + t_b) of every pose, float32 mm."""
        rest = np.concatenate([self.neutral.astype(np.float64), np.ones((len(self.neutral), 1))], 1)
        motion = np.concatenate([rotation, translation[:, :, None, :]], 2)  # (b, bones, 4, 3)
        spread = weighted_points(rest, self.dense_weights())
        result = np.empty((len(rotation), len(rest), 3), np.float32)
        for pose, of_pose in zip(result, motion, strict=True):
            pose[:] = spread @ of_pose.reshape(-1, 3)
        return result

    def save(self, path: Path) -> None:
        """Write the skin as one npz file."""
        np.savez(path, neutral=self.neutral, bone_index=self.bone_index, weights=self.weights, bones=self.bones)

    @staticmethod
    def load(path: Path) -> "Skin":
        """Read what `save` wrote."""
        with np.load(path, allow_pickle=False) as a:
            return Skin(a["neutral"], a["bone_index"], a["weights"], int(a["bones"]))


def fit(
    neutral: Float[np.ndarray, "n 3"],
    vertices: Float[np.ndarray, "f n 3"],
    bones: int,
    generator: np.random.Generator,
    influences: int = 8,
    iterations: int = 100,
    scratch: Path | None = None,
    progress: Callable | None = None,
    faces: Int[np.ndarray, "t 3"] | None = None,
    coherence: float = 0.2,
    relaxed: int = 60,
) -> Skin:
    """Fit bones and sparse convex weights to example poses.

    The result depends on the order of neither vertices nor poses. Raises InputError for no poses, for coordinates that
    are not finite, and for more bones than the mesh has vertices.

    neutral: rest positions, mm.
    vertices: the poses, mm, float32.
    bones: how many.
    generator: draws the compression's sketch and nothing else.
    influences: bones a vertex at most.
    iterations: after the relaxed ones.
    scratch: a folder that keeps the state every few seconds, so that a killed fit goes on from there and ends with the
        same bits; the state of other data or settings is ignored.
    progress: (total, label, initial) → context manager with `update(k)`.
    faces: the mesh's triangles; with them, borders between bones start out blended, and the fit also keeps errors alike
        along edges (`edge_metric`; DEVIATIONS, LBS).
    coherence: how much the latter weighs against distance.
    relaxed: iterations before the others, in which all bones may act on every vertex.
    """
    # poses in canonical order, compressed
    check(neutral, vertices, bones, influences)
    vertex_order, pose_order = canonical_order(neutral, vertices)
    examples = vertices[pose_order[:, None], vertex_order[None, :]]
    rest = neutral[vertex_order]
    ranks = np.argsort(vertex_order)
    corners = np.zeros((0, 3), np.int64) if faces is None else ranks[faces]
    checkpoints = Checkpoints(scratch, fingerprint(rest, examples, corners, bones, influences, coherence, relaxed))
    data = checkpoints.data()
    if data is None:
        data = compress(rest, examples, generator)
        checkpoints.keep_data(data)
    del examples
    # the alternation, from where it stood
    course, total = alternation(data, corners, coherence, influences, relaxed), relaxed + iterations
    state = checkpoints.state() or course.start(bones)
    with progress(total, f"LBS, {bones} bones", state.iteration) if progress else nullcontext() as bar:
        while state.iteration < total:
            state = course.step(state)
            checkpoints.keep_state(state, at_once=state.iteration == total)
            if bar is not None:
                bar.update(1)
    return skin_of(neutral, vertex_order, state)


def check(neutral: np.ndarray, vertices: np.ndarray, bones: int, influences: int) -> None:
    """Raise InputError unless the poses can be fitted."""
    if vertices.ndim != 3 or not len(vertices) or vertices.shape[1:] != neutral.shape or neutral.shape[1:] != (3,):
        raise InputError(
            f"LBS: expected at least one pose (f, n, 3) of a rest mesh (n, 3), "
            f"got poses {vertices.shape} and a rest mesh {neutral.shape}"
        )
    if not 1 <= bones <= len(neutral):
        raise InputError(f"LBS: expected 1 to {len(neutral)} bones (as many as vertices), got {bones}")
    if influences < 1:
        raise InputError(f"LBS: expected at least 1 influence a vertex, got {influences}")
    if not np.isfinite(neutral).all():
        raise InputError("LBS: the rest mesh has a coordinate that is not finite")
    for f, pose in enumerate(vertices):
        if not np.isfinite(pose).all():
            raise InputError(f"LBS: pose {f} has a coordinate that is not finite")


def skin_of(neutral: Float[np.ndarray, "n 3"], vertex_order: Int[np.ndarray, "n"], state: State) -> Skin:
    """Return the skin of a state, its vertices back in the order of the mesh."""
    index = np.zeros(state.bone_index.shape, np.int32)
    weights = np.zeros(state.weights.shape, np.float32)
    index[vertex_order], weights[vertex_order] = state.bone_index, state.weights
    return Skin(np.asarray(neutral, np.float32), index, weights, state.motion.shape[2])


def refit(
    skin: Skin, vertices: Float[np.ndarray, "b n 3"], sweeps: int = 500, tolerance: float = 1e-7
) -> tuple[Float[np.ndarray, "b bones 3 3"], Float[np.ndarray, "b bones 3"]]:
    """Return the bone rotations and translations (mm) that best pose a skin as some meshes, its weights fixed.

    Sweeps end once one moves no bone by more than `tolerance` (radians and rest radii), after `sweeps` at the latest.
    """
    points, centre, radius = rest_frame(skin.neutral)
    z = weighted_points(points, skin.dense_weights())
    vu = (scaled_displacements(skin.neutral, vertices, radius).astype(np.float64) @ z).reshape(len(vertices), 3, -1)
    motion = sweep(np.zeros((len(vertices), 3, skin.bones, 4)), z.T @ z, vu, sweeps, tolerance)
    rotation = motion[:, :, :, :3].transpose(0, 2, 3, 1) + np.eye(3)  # (b, bones, 3, 3), row vectors
    translation = motion[:, :, :, 3].swapaxes(1, 2) * radius + centre - centre @ rotation
    return rotation, translation


# Checkpoints of an SSDR fit on disk, so that a killed fit goes on where it stood.

SECONDS = 20.0  # between two checkpoints


class Checkpoints:
    """A folder with the compressed poses and the last state of one fit; without a folder, nothing is stored.

    Files appear whole and have a checksum and the fingerprint of their fit: those of another fit, and damaged ones, are
    ignored.
    """

    def __init__(self, folder: Path | None, fingerprint: str) -> None:
        self.folder = folder
        self.fingerprint = fingerprint
        self.last_write = time.monotonic()

    def data(self) -> CompressedPoses | None:
        """Return the compressed poses, if they are stored."""
        arrays = self._read("compressed.sealed")
        return arrays and CompressedPoses(**_scalars(arrays, "radius_mm", "lost"))

    def keep_data(self, data: CompressedPoses) -> None:
        """Store the compressed poses."""
        self._write("compressed.sealed", vars(data))

    def state(self) -> State | None:
        """Return the last stored state."""
        arrays = self._read("state.sealed")
        return arrays and State(**_scalars(arrays, "iteration", "energy", "beta"))

    def keep_state(self, state: State, at_once: bool = False) -> None:
        """Store a state if the last one is old enough, or at once."""
        if at_once or time.monotonic() - self.last_write >= SECONDS:
            self._write("state.sealed", vars(state))
            self.last_write = time.monotonic()

    def _read(self, name: str) -> dict | None:
        arrays = None if self.folder is None else read_sealed(self.folder / name, _arrays)
        return arrays if arrays and str(arrays.pop("fingerprint", "")) == self.fingerprint else None

    def _write(self, name: str, arrays: dict) -> None:
        if self.folder is not None:
            contents = {"fingerprint": self.fingerprint, **arrays}
            write_sealed(self.folder / name, lambda stream: np.savez(stream, **contents))


def _arrays(stream: BinaryIO) -> dict[str, np.ndarray]:
    with np.load(stream, allow_pickle=False) as file:
        return {key: file[key] for key in file.files}


def _scalars(arrays: dict, *names: str) -> dict:
    return arrays | {name: arrays[name].item() for name in names}


def fingerprint(*parts: np.ndarray | float) -> str:
    """Return a hash of all that a fit's intermediate results depend on: arrays, with their types, and numbers."""
    digest = hashlib.blake2b()
    for part in parts:
        array = np.ascontiguousarray(part)
        digest.update(json.dumps([str(array.dtype), array.shape]).encode())
        digest.update(array)
    return digest.hexdigest()
