"""A rig that is known by its samples alone: it keeps the Rig contract, but its function knows these poses only."""

from __future__ import annotations

import json
import zipfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float32
from numpy.typing import ArrayLike

from data_recipes.controls import Control
from data_recipes.function_rig import ControlledRig, check_parts
from data_recipes.rig import Clip, KnownPoses
from replicate.base.exceptions import InputError
from replicate.base.files import write_text
from replicate.geometry.mesh import Mesh


class UnknownPoseError(InputError):
    """A rig that is known by its samples was asked for a pose that is none of them."""


@dataclass(frozen=True)
class SampledRig(ControlledRig):
    """A character with poses and no function; its fields are those of `rig.Rig`, and some more.

    It is called like any rig, with the default pose or poses that are among its samples to the bit; any other pose
    raises UnknownPoseError. It has no derivative. Raises InputError as a `FunctionRig` does.

    known_poses: all its samples.
    frames_per_second: of its clips.
    source, licence: texts of its author.
    moves: (n, m), which control moves which vertex, if its author says so.
    rigid_segments: names of those that move rigidly, if its author says so.
    file_vertices: for each vertex of its file its place among the rig's, where that has coincident ones once; else ().
    """

    name: str
    mesh: Mesh
    controls: tuple[Control, ...]
    landmarks: np.ndarray
    control_points: np.ndarray
    control_point_regions: tuple[str, ...]
    clips: tuple[Clip, ...] | None
    known_poses: KnownPoses
    frames_per_second: float = 24.0
    source: str = ""
    licence: str = ""
    landmark_names: tuple[str, ...] = ()
    control_point_names: tuple[str, ...] = ()
    moves: np.ndarray | None = None
    rigid_segments: tuple[str, ...] = ()
    file_vertices: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int32))

    def __post_init__(self) -> None:
        for name in ("landmarks", "control_points"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), np.int32))
        check_parts(self)

    @property
    def face_marks(self) -> np.ndarray:
        """The control points mark the regions of the face."""
        return self.control_points

    @property
    def face_mark_regions(self) -> tuple[str, ...]:
        """The region of each control point."""
        return self.control_point_regions

    def __call__(self, params: ArrayLike) -> np.ndarray:
        """Return the vertices (n, 3) or (b, n, 3), float32 mm, of one known pose (m,) or a batch (b, m)."""
        p = np.asarray(params, np.float32)
        if p.ndim not in (1, 2) or p.shape[-1] != len(self.controls):
            shapes = f"({len(self.controls)},) or (b, {len(self.controls)})"
            raise InputError(f"rig '{self.name}': expected parameters of the shape {shapes}, got {p.shape}.")
        if p.ndim == 1:
            return self.mesh.neutral + self._offsets(p)
        return np.stack([self.mesh.neutral + self._offsets(row) for row in p])

    def _offsets(self, params: Float32[np.ndarray, " m"]) -> np.ndarray:
        place = self.known_poses.find(params)
        if place is not None:
            return self.known_poses.offsets(place)
        if np.array_equal(params, self.default):
            return np.zeros_like(self.mesh.neutral)
        raise UnknownPoseError(
            f"rig '{self.name}': it is known by its samples alone, and this pose is none of these "
            f"{len(self.known_poses):,}."
        )


# Sampled rigs on disk: arrays and one JSON description, no pickle; their poses stay memory-mapped.

DESCRIPTION, MESH, POINTS, MOVES = "sampled_rig.json", "mesh.npz", "points.npz", "moves.npy"
FORMAT = 3
TEXTS = ("frames_per_second", "source", "licence", "control_point_regions", "rigid_segments")


def is_sampled(folder: Path) -> bool:
    """Return whether a folder holds a sampled rig."""
    return (folder / DESCRIPTION).is_file()


def save_rig(rig: SampledRig, folder: Path) -> None:
    """Write a rig into the folder that has its poses; the description goes last."""
    rig.mesh.save(folder / MESH)
    points = {name: getattr(rig, name) for name in ("landmarks", "control_points", "file_vertices")}
    np.savez(folder / POINTS, **points)
    if rig.moves is not None:
        np.save(folder / MOVES, rig.moves)
    description = {
        "format": FORMAT,
        "name": rig.name,
        "controls": [[c.name, c.lower, c.default, c.upper, c.region] for c in rig.controls],
        "clips": None if rig.clips is None else [[clip.name, len(clip.values)] for clip in rig.clips],
        "has_moves": rig.moves is not None,
        **{name: getattr(rig, name) for name in TEXTS},
    }
    write_text(folder / DESCRIPTION, json.dumps(description, indent=1) + "\n")


def load_rig(folder: Path) -> SampledRig:
    """Read a rig that `save_rig` wrote. Raises InputError when the folder's files are damaged or of another format."""
    try:
        about = json.loads((folder / DESCRIPTION).read_text(encoding="utf-8"))
        if about["format"] != FORMAT:
            raise InputError(f"{folder / DESCRIPTION}: expected format {FORMAT}, got {about['format']}.")
        known = KnownPoses.open(folder)
        with np.load(folder / POINTS, allow_pickle=False) as points:
            landmarks, control_points, places = (
                points[name] for name in ("landmarks", "control_points", "file_vertices")
            )
        clips, first = [], 0
        for name, length in about["clips"] or ():
            clips.append(Clip(name, np.array(known.frame_params[first : first + length])))
            first += length
        return SampledRig(
            name=about["name"],
            mesh=Mesh.load(folder / MESH),
            controls=tuple(Control(*control) for control in about["controls"]),
            landmarks=landmarks,
            control_points=control_points,
            control_point_regions=tuple(about["control_point_regions"]),
            clips=tuple(clips) or None,
            known_poses=known,
            frames_per_second=about["frames_per_second"],
            source=about["source"],
            licence=about["licence"],
            moves=np.load(folder / MOVES, allow_pickle=False) if about["has_moves"] else None,
            rigid_segments=tuple(about["rigid_segments"]),
            file_vertices=places,
        )
    except (OSError, KeyError, TypeError, ValueError, zipfile.BadZipFile) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{folder}: not a readable sampled rig ({error}).") from error
