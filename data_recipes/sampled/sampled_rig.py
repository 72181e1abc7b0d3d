"""A rig that is known by its samples alone: it keeps the Rig contract, with a function of known poses only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32
from numpy.typing import ArrayLike

from data_recipes.controlled_rig import ControlledRig
from data_recipes.controls import Control
from data_recipes.function_rig import check_parts
from data_recipes.known_poses import KnownPoses
from data_recipes.rig import Clip
from replicate.engine.exceptions import InputError
from replicate.geometry.mesh import Mesh


class UnknownPoseError(InputError):
    """A rig that is known by its samples was asked for a pose that is none of them."""


@dataclass(frozen=True)
class SampledRig(ControlledRig):
    """A character of which there are poses and no function; the fields are the contract's (see `rig.Rig`).

    known_poses: all that there are. frames_per_second: of its clips. source, licence: texts of whoever brought it.
    moves: which control moves which vertex, (n, m), where whoever brought it knows.

    It is called like any rig, for the default pose and for poses that are among its samples, to the bit; any other one
    raises UnknownPoseError. It has no derivative. Raises InputError as a `FunctionRig` does.
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

    def __post_init__(self) -> None:
        for field in ("landmarks", "control_points"):
            object.__setattr__(self, field, np.asarray(getattr(self, field), np.int32))
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
            raise InputError(f"rig '{self.name}': parameters have the shape {p.shape}, where {shapes} is allowed.")
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
