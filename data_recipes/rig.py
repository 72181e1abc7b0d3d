"""The Rig contract: what the rest of the suite expects of a character.

A rig is a mesh, named controls, and a function r(p) from a batch of parameters (b, m) to vertices (b, n, 3) in mm.
`FunctionRig` makes one of any such function; those that come with the suite are built by `catalogue.build_rig`. A rig
whose function stays in another program is known by its samples: `sampled.SampledRig`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

from data_recipes.controls import Control
from replicate.base.exceptions import InputError
from replicate.geometry.mesh import Mesh

__all__ = [
    "BATCH",
    "AlteredRig",
    "Clip",
    "KnownPoses",
    "Prop",
    "Rig",
    "check_rig",
    "frames_per_second",
    "has_function",
    "rigid_names",
    "within_limits",
]

# Poses that rigs evaluate at once. Callers with many poses pass this many, so that no batch has to be padded. The
# working memory of 24 film faces stays below 32 MiB; more would go back to the system after each call.
BATCH = 24
Prop = tuple[str, np.ndarray, np.ndarray, np.ndarray]  # name, vertices (k, 3), faces (f, 3), colours (k, 3) uint8


@dataclass(frozen=True)
class Clip:
    """A piece of animation: parameters (t, m), 24 frames a second."""

    name: str
    values: np.ndarray


@runtime_checkable
class Rig(Protocol):
    """A character of n vertices and m controls."""

    @property
    def name(self) -> str:
        """The character's name."""
        ...

    @property
    def mesh(self) -> Mesh:
        """The neutral pose in mm, with its segments and charts."""
        ...

    @property
    def controls(self) -> tuple[Control, ...]:
        """The controls, in the order of p."""
        ...

    @property
    def lower(self) -> Float32[np.ndarray, " m"]:
        """The controls' lower limits."""
        ...

    @property
    def default(self) -> Float32[np.ndarray, " m"]:
        """The controls' defaults: the neutral pose."""
        ...

    @property
    def upper(self) -> Float32[np.ndarray, " m"]:
        """The controls' upper limits."""
        ...

    @property
    def landmarks(self) -> Int[np.ndarray, " l"]:
        """The 20 to 30 vertices whose positions samples are balanced by (§3.5)."""
        ...

    @property
    def landmark_names(self) -> tuple[str, ...]:
        """A name for each landmark, or none at all."""
        ...

    @property
    def control_points(self) -> Int[np.ndarray, " c"]:
        """The vertices that inverse kinematics drags (§4)."""
        ...

    @property
    def control_point_regions(self) -> tuple[str, ...]:
        """The region of each control point."""
        ...

    @property
    def control_point_names(self) -> tuple[str, ...]:
        """A name for each control point, or none at all."""
        ...

    @property
    def face_marks(self) -> Int[np.ndarray, " k"]:
        """Vertices that mark the regions of the face: skin belongs to the region of the nearest one."""
        ...

    @property
    def face_mark_regions(self) -> tuple[str, ...]:
        """The region of each of the face's marks."""
        ...

    @property
    def clips(self) -> tuple[Clip, ...] | None:
        """The animation, or None; poses are then drawn uniformly."""
        ...

    @property
    def nodes(self) -> tuple:
        """The deformers in order, each with a `name`, if they can be run one by one; else none."""
        ...

    @property
    def paint(self) -> UInt8[np.ndarray, "n 3"] | None:
        """A colour for each vertex, for display only, or None."""
        ...

    def __call__(self, params: Float[np.ndarray, "*b m"]) -> Float32[np.ndarray, "*b n 3"]:
        """Return the vertices (n, 3) or (b, n, 3), mm, of one pose (m,) or a batch (b, m)."""
        ...

    def pose_props(self, params: Float[np.ndarray, " m"]) -> list[Prop]:
        """Return the display-only meshes (eyeballs, brows, …) in the pose (m,); a rig need not have any."""
        return []


class AlteredRig:
    """A rig like another one of any class, except for some fields of the contract."""

    name: str
    mesh: Mesh
    controls: tuple[Control, ...]
    lower: Float32[np.ndarray, " m"]
    default: Float32[np.ndarray, " m"]
    upper: Float32[np.ndarray, " m"]
    landmarks: Int[np.ndarray, " l"]
    landmark_names: tuple[str, ...]
    control_points: Int[np.ndarray, " c"]
    control_point_regions: tuple[str, ...]
    control_point_names: tuple[str, ...]
    face_marks: Int[np.ndarray, " k"]
    face_mark_regions: tuple[str, ...]
    clips: tuple[Clip, ...] | None
    nodes: tuple
    paint: UInt8[np.ndarray, "n 3"] | None

    def __init__(self, rig: Rig, **fields: object):
        self._rig = rig
        for name in AlteredRig.__annotations__:
            setattr(self, name, fields.get(name, getattr(rig, name)))
        if not has_function(rig):
            self.known_poses = getattr(rig, "known_poses")  # noqa: B009

    def __call__(self, params: Float[np.ndarray, "*b m"]) -> Float32[np.ndarray, "*b n 3"]:
        """Return the vertices (n, 3) or (b, n, 3), mm, of one pose (m,) or a batch (b, m)."""
        return self._rig(params)

    def pose_props(self, params: Float[np.ndarray, " m"]) -> list[Prop]:
        """Return the display-only meshes in the pose (m,)."""
        return self._rig.pose_props(params)


def has_function(rig: Rig) -> bool:
    """Return whether a rig gives vertices at any pose; one known by its samples gives them only there."""
    return getattr(rig, "known_poses", None) is None


def within_limits(rig: Rig, poses: Float32[np.ndarray, "b m"]) -> Float32[np.ndarray, "b m"]:
    """Return poses as a rig can take them: clipped to the controls' limits where these are hard, else as they are."""
    return np.clip(poses, rig.lower, rig.upper) if getattr(rig, "hard_limits", False) else poses


def rigid_names(rig: Rig) -> tuple[str, ...]:
    """Return the segments that a rig's author says are rigid, as teeth are; none if they say nothing."""
    return tuple(getattr(rig, "rigid_segments", ()))


def frames_per_second(rig: Rig) -> float:
    """Return how fast a rig's clips are played: 24 frames a second, unless it says otherwise."""
    return getattr(rig, "frames_per_second", 24.0)


def check_rig(rig: Rig, tolerance_mm: float = 1e-3) -> Rig:
    """Return the rig, after a check that its function gives the neutral mesh at the default pose.

    Raises InputError for another shape, and for a vertex that is off or not finite.
    """
    n = len(rig.mesh.neutral)
    vertices = np.asarray(rig(rig.default[None]), np.float32)
    if vertices.shape != (1, n, 3):
        raise InputError(
            f"rig '{rig.name}': expected vertices of the shape (1, {n}, 3) for one pose, got {vertices.shape}"
        )
    off = np.abs(vertices[0] - rig.mesh.neutral).max(axis=1)
    bad = np.flatnonzero(~(off <= tolerance_mm))  # NaN counts as off
    if len(bad):
        raise InputError(
            f"rig '{rig.name}': at the default pose vertex {bad[0]} lies {off[bad[0]]:.4g} mm from the neutral; "
            f"expected at most {tolerance_mm:g} mm"
        )
    return rig


# The poses of a rig that is known by its samples: memory-mapped arrays in a folder.

INT16_MAX = 32767
ROUNDED = ("drawn_whole", "drawn_steps")
NAMES = ("frame_params", "frame_offsets", "drawn_params", *ROUNDED, "drawn_source")


@dataclass(frozen=True)
class KnownPoses:
    """Frames of clips, from which test poses are taken, and poses drawn at random, rounded as in D4.

    frame_params: (a, m); without clips, all poses are frames
    frame_offsets: (a, n, 3), float32, mm from the neutral pose
    drawn_params: (d, m)
    drawn_whole: (d, n, 3), int16, in steps from the neutral pose
    drawn_steps: (d,), the size of a pose's steps, mm
    drawn_source: (d,), the frame that each was drawn from, or −1
    """

    frame_params: np.ndarray
    frame_offsets: np.ndarray
    drawn_params: np.ndarray
    drawn_whole: np.ndarray
    drawn_steps: np.ndarray
    drawn_source: np.ndarray

    @classmethod
    def open(cls, folder: Path) -> KnownPoses:
        """Open what `create` made. Raises OSError or ValueError for a file that is missing or damaged."""
        return cls(*(np.load(folder / f"{name}.npy", mmap_mode="r", allow_pickle=False) for name in NAMES))

    def __len__(self) -> int:
        return len(self.frame_params) + len(self.drawn_params)

    @cached_property
    def places(self) -> Mapping[bytes, int]:
        """The place of each pose, frames first, by the bytes of its parameters; the first one of equal poses."""
        rows = [*self.frame_params, *self.drawn_params]
        return {pose.tobytes(): k for k, pose in reversed(list(enumerate(rows)))}

    def offsets(self, place: int) -> Float32[np.ndarray, "n 3"]:
        """Return the offsets (mm) of the pose at a place."""
        k = place - len(self.frame_params)
        return self.frame_offsets[place] if k < 0 else self.drawn_whole[k] * self.drawn_steps[k]

    def find(self, params: Float[np.ndarray, " m"]) -> int | None:
        """Return the place of the pose with these parameters, or None."""
        return self.places.get((np.asarray(params, np.float32) + np.float32(0)).tobytes())


def create(folder: Path, frames: int, drawn: int, vertices: int, controls: int) -> KnownPoses:
    """Create the files of `KnownPoses` in a folder, and return them to be filled.

    frames, drawn: how many poses of each kind
    vertices, controls: n and m
    """
    shapes = {
        "frame_params": (np.float32, (frames, controls)),
        "frame_offsets": (np.float32, (frames, vertices, 3)),
        "drawn_params": (np.float32, (drawn, controls)),
        "drawn_whole": (np.int16, (drawn, vertices, 3)),
        "drawn_steps": (np.float32, (drawn,)),
        "drawn_source": (np.int64, (drawn,)),
    }
    make = np.lib.format.open_memmap
    return KnownPoses(*(make(folder / f"{name}.npy", "w+", *shapes[name]) for name in NAMES))
