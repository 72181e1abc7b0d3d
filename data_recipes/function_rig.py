"""A rig made of any function r(p), JAX or plain numpy, with the fields that the contract asks for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Int, UInt8
from numpy.typing import ArrayLike

from data_recipes.controls import Control
from data_recipes.rig import BATCH, Clip, Prop, Rig
from replicate.base.exceptions import InputError
from replicate.geometry.mesh import Mesh


class ControlledRig:
    """The part of the Rig contract that follows from the m controls, with no nodes, paint or props."""

    controls: tuple[Control, ...]

    @property
    def lower(self) -> Float32[np.ndarray, " m"]:
        """The controls' lower limits."""
        return np.array([c.lower for c in self.controls], np.float32)

    @property
    def default(self) -> Float32[np.ndarray, " m"]:
        """The controls' defaults: the neutral pose."""
        return np.array([c.default for c in self.controls], np.float32)

    @property
    def upper(self) -> Float32[np.ndarray, " m"]:
        """The controls' upper limits."""
        return np.array([c.upper for c in self.controls], np.float32)

    @property
    def nodes(self) -> tuple:
        """The deformers that can be run one by one: none, unless a rig says so."""
        return ()

    @property
    def paint(self) -> UInt8[np.ndarray, "n 3"] | None:
        """A colour for each vertex: None."""
        return None

    def pose_props(self, params: Float[np.ndarray, " m"]) -> list[Prop]:
        """Return the display-only meshes in the pose (m,): none."""
        return []


POINTS = ("landmarks", "control_points", "face_marks")


@dataclass(frozen=True)
class FunctionRig(ControlledRig):
    """A character whose poses a function gives; the other fields are those of `rig.Rig`.

    function: parameters (b, m) in float32 → vertices (b, n, 3) in mm
    face_marks: without any, the control points take their place

    Raises InputError for indices out of range, and for controls or clips that don't fit.
    """

    name: str
    mesh: Mesh
    controls: tuple[Control, ...]
    landmarks: np.ndarray
    control_points: np.ndarray
    control_point_regions: tuple[str, ...]
    clips: tuple[Clip, ...] | None
    function: Callable[[Any], Any]
    landmark_names: tuple[str, ...] = ()
    control_point_names: tuple[str, ...] = ()
    face_marks: np.ndarray = field(default_factory=lambda: np.empty(0, np.int32))
    face_mark_regions: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if len(self.face_marks) == 0:
            object.__setattr__(self, "face_marks", self.control_points)
            object.__setattr__(self, "face_mark_regions", self.control_point_regions)
        for name in POINTS:
            object.__setattr__(self, name, np.asarray(getattr(self, name), np.int32))
        check_parts(self)

    def __call__(self, params: ArrayLike) -> np.ndarray:
        """Return the vertices (n, 3) or (b, n, 3), float32 mm, of one pose (m,) or a batch (b, m)."""
        p = np.asarray(params, np.float32)
        if p.ndim not in (1, 2) or p.shape[-1] != len(self.controls):
            shapes = f"({len(self.controls)},) or (b, {len(self.controls)})"
            raise InputError(f"rig '{self.name}': expected parameters of the shape {shapes}, got {p.shape}")
        if p.ndim == 1 or len(p) == 1:
            vertices = np.asarray(self.function(p.reshape(1, -1)), np.float32)
            return vertices[0] if p.ndim == 1 else vertices
        # In parts of equal size: JAX compiles a function anew for each size.
        out = np.empty((len(p), *self.mesh.neutral.shape), np.float32)
        for first in range(0, len(p), BATCH):
            part = p[first : first + BATCH]
            padded = np.concatenate([part, np.repeat(part[-1:], BATCH - len(part), axis=0)])
            out[first : first + BATCH] = np.asarray(self.function(padded), np.float32)[: len(part)]
        return out

    @cached_property
    def _tangents(self) -> Callable:
        import jax  # rigs of plain numpy do without it

        def push(p, tangents):
            pose = lambda q: self.function(q[None])[0]  # noqa: E731
            return jax.vmap(lambda t: jax.jvp(pose, (p,), (t,))[1])(tangents)

        return jax.jit(push)

    def jacobian(
        self, params: Float[np.ndarray, " m"], columns: Sequence[int] | Int[np.ndarray, " k"] | None = None
    ) -> Float32[np.ndarray, "n 3 k"]:
        """Return ∂V/∂p (n, 3, m) in mm per unit of each control, exact, by forward differentiation.

        columns: the controls, by their place in p; None for all. The function must be one that JAX can trace, as those
        of our rigs are.
        """
        p, every = np.asarray(params, np.float32), np.eye(len(self.controls), dtype=np.float32)
        directions = every if columns is None else every[np.asarray(columns, int)]
        k = len(directions)
        size = min(k, BATCH)
        seeds = np.concatenate([directions, np.zeros((-k % size, len(p)), np.float32)])
        parts = [np.asarray(self._tangents(p, seeds[i : i + size])) for i in range(0, len(seeds), size)]
        return np.moveaxis(np.concatenate(parts)[:k], 0, 2)


def check_parts(rig: Rig) -> None:
    """Raise InputError for a rig whose controls, points, regions, names or clips don't fit together."""
    where, n, m = f"rig '{rig.name}'", len(rig.mesh.neutral), len(rig.controls)
    if m == 0:
        raise InputError(f"{where}: it has no controls, but a rig needs at least one")
    names = [c.name for c in rig.controls]
    if len(set(names)) < m:
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"{where}: the control '{twice}' is there twice; names must be unique")
    for points in POINTS:
        index = getattr(rig, points)
        bad = np.flatnonzero((index < 0) | (index >= n))
        if index.ndim != 1 or len(bad):
            found = f"[{bad[0]}] is {index[bad[0]]}" if index.ndim == 1 else f" has the shape {index.shape}"
            raise InputError(f"{where}: {points}{found}; expected a list of vertices from 0 to {n - 1}")
    for regions, points in (("control_point_regions", "control_points"), ("face_mark_regions", "face_marks")):
        found, count = len(getattr(rig, regions)), len(getattr(rig, points))
        if found != count:
            raise InputError(f"{where}: expected {count} {regions}, one for each of the {points}, got {found}")
    if rig.control_point_names and len(rig.control_point_names) != len(rig.control_points):
        raise InputError(
            f"{where}: expected {len(rig.control_points)} control_point_names, one for each of the control_points, "
            f"or none, got {len(rig.control_point_names)}"
        )
    for clip in rig.clips or ():
        if clip.values.ndim != 2 or clip.values.shape[1] != m:
            shape = clip.values.shape
            raise InputError(f"{where}: clip '{clip.name}': expected values of the shape (frames, {m}), got {shape}")
        if not np.isfinite(clip.values).all():
            raise InputError(f"{where}: clip '{clip.name}': expected finite values, got NaN or infinity")
