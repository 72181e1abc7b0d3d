"""The Rig contract: what a character is to the rest of the suite. The only module here that `replicate/` imports.

A rig is a mesh, named controls, and a function r(p) from a batch of parameters (b, m) to vertices (b, n, 3) in mm.
Ours are JAX inside and come from a recipe: `build_rig("teen")`. Anyone else's needs the same fields and any function;
it need not be differentiable.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32, Int, UInt8

from data_recipes.controls import Control
from replicate.approximation.sampling import (
    augment,
    balance_bins,
    bin_index,
    draw_from_index,
    hold_out,
    sample_uniform,
    split_clips,
    split_frames,
)
from replicate.engine.exceptions import InputError
from replicate.engine.paths import character_names, recipe_file
from replicate.geometry.mesh import Mesh

__all__ = [
    "Clip",
    "Control",
    "Rig",
    "augment",
    "balance_bins",
    "bin_index",
    "build_rig",
    "check_rig",
    "draw_from_index",
    "expression_poses",
    "hold_out",
    "load_rig",
    "read_clip",
    "recipe_files",
    "rig_names",
    "sample_uniform",
    "save_rig",
    "split_clips",
    "split_frames",
]

BATCH = 32  # poses evaluated at once; larger calls go through in parts, so that a function compiles for few sizes
Prop = tuple[str, np.ndarray, np.ndarray, np.ndarray]  # name, vertices (k, 3), faces (f, 3), colours (k, 3) uint8


@dataclass(frozen=True)
class Clip:
    """A piece of animation: parameters (t, m), 24 frames a second."""

    name: str
    values: np.ndarray


@dataclass(frozen=True)
class Rig:
    """A character.

    mesh: the neutral with its segments and charts; controls: m of them, in the order of p;
    landmarks: (l,) 20–30 vertices, named by `landmark_names` where known;
    control_points: (c,) vertices that inverse kinematics drags, with their regions;
    clips: its animation, or None (poses are then drawn uniformly);
    function: (b, m) → (b, n, 3) mm. For parameters in float32 it may be JAX or plain numpy;
    face: our own rigs' constants (see deformers/face.py), from which nodes, props and files are made; None for others.

    Raises InputError for indices out of range, controls or clips that don't fit.
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
    face: Any = None

    def __post_init__(self) -> None:
        for field in ("landmarks", "control_points"):
            object.__setattr__(self, field, np.asarray(getattr(self, field), np.int32))
        _check(self)

    def __call__(self, params) -> np.ndarray:
        """Return the vertices (n, 3) or (b, n, 3), float32 mm, of one pose (m,) or a batch (b, m)."""
        p = np.asarray(params, np.float32)
        if p.ndim not in (1, 2) or p.shape[-1] != len(self.controls):
            allowed = f"({len(self.controls)},) or (b, {len(self.controls)})"
            raise InputError(f"rig '{self.name}': parameters have the shape {p.shape}, where {allowed} is allowed.")
        if p.ndim == 1 or len(p) == 1:
            vertices = np.asarray(self.function(p.reshape(1, -1)), np.float32)
            return vertices[0] if p.ndim == 1 else vertices
        out = np.empty((len(p), *self.mesh.neutral.shape), np.float32)
        for first in range(0, len(p), BATCH):
            part = p[first : first + BATCH]
            padded = np.concatenate([part, np.repeat(part[-1:], BATCH - len(part), axis=0)])
            out[first : first + BATCH] = np.asarray(self.function(padded), np.float32)[: len(part)]
        return out

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

    @cached_property
    def _tangents(self) -> Callable:
        import jax

        def push(p, tangents):
            pose = lambda q: self.function(q[None])[0]  # noqa: E731
            return jax.vmap(lambda t: jax.jvp(pose, (p,), (t,))[1])(tangents)

        return jax.jit(push)

    def jacobian(
        self, params, columns: Sequence[int] | Int[np.ndarray, " k"] | None = None
    ) -> Float32[np.ndarray, "n 3 k"]:
        """Return ∂V/∂p (n, 3, m) in mm per unit of each control, exact, by forward differentiation.

        columns: the controls wanted, by their place in p; None for all. Needs a function that JAX can trace; our own
        rigs' can.
        """
        p, every = np.asarray(params, np.float32), np.eye(len(self.controls), dtype=np.float32)
        wanted = every if columns is None else every[np.asarray(columns, int)]
        k = len(wanted)
        size = min(k, BATCH)
        seeds = np.concatenate([wanted, np.zeros((-k % size, len(p)), np.float32)])
        parts = [np.asarray(self._tangents(p, seeds[i : i + size])) for i in range(0, len(seeds), size)]
        return np.moveaxis(np.concatenate(parts)[:k], 0, 2)

    @property
    def nodes(self) -> tuple:
        """The deformers in order, each a name and a `function(constants, state) → state`; none for foreign rigs."""
        from data_recipes.face_rig import CHAINS

        return CHAINS[self.face.chain][0].NODES if self.face is not None else ()

    def run_nodes(self, params, skip: Collection[str] = (), upto: str | None = None) -> np.ndarray:
        """Return the vertices (b, n, 3) of (b, m) by running each node for itself, as a production engine does.

        skip: names of nodes to switch off; upto: the last node to run. Raises InputError for unknown names and for
        foreign rigs.
        """
        from data_recipes.face_rig import run_nodes

        return run_nodes(self, params, skip, upto)

    def node_steps(self, params, skip: Collection[str] = (), upto: str | None = None) -> Iterator[tuple[str, Any]]:
        """Run the nodes as `run_nodes` does and yield, when each is done, its name and the state after it.

        The state's "x" are the positions so far as planes (b, 3, n), "u" the limited controls (b, m).
        """
        from data_recipes.face_rig import node_steps

        return node_steps(self, params, skip, upto)

    def wrinkle_states(self, params) -> dict[str, Any]:
        """Return each wrinkle region's vertices, compression c̃, excess c₊ and height_mm, (s,), in the pose (m,)."""
        from data_recipes.face_rig import wrinkle_states

        return wrinkle_states(self, params)

    @property
    def paint(self) -> UInt8[np.ndarray, "n 3"] | None:
        """A colour for each vertex, for display only; None for foreign rigs."""
        return self.face.paint if self.face is not None else None

    def pose_props(self, params) -> list[Prop]:
        """Return the display-only meshes (eyeballs, brows, …) in the pose (m,); none for foreign rigs."""
        if self.face is None:
            return []
        from data_recipes.face_rig import pose_props

        return pose_props(self, params)


def _check(rig: Rig) -> None:
    where, n, m = f"rig '{rig.name}'", len(rig.mesh.neutral), len(rig.controls)
    if m == 0:
        raise InputError(f"{where}: it has no controls, where at least one is needed.")
    names = [c.name for c in rig.controls]
    if len(set(names)) < m:
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"{where}: the control '{twice}' is there twice, where each name is allowed once.")
    for field in ("landmarks", "control_points"):
        index = getattr(rig, field)
        bad = np.flatnonzero((index < 0) | (index >= n))
        if index.ndim != 1 or len(bad):
            found = f"[{bad[0]}] is {index[bad[0]]}" if index.ndim == 1 else f" has the shape {index.shape}"
            raise InputError(f"{where}: {field}{found}, where a list of vertices from 0 to {n - 1} is allowed.")
    if len(rig.control_point_regions) != len(rig.control_points):
        found = f"{len(rig.control_point_regions)} control_point_regions"
        raise InputError(
            f"{where}: found {found}, where one for each of the {len(rig.control_points)} control points is allowed."
        )
    for clip in rig.clips or ():
        if clip.values.ndim != 2 or clip.values.shape[1] != m or not np.isfinite(clip.values).all():
            shape = clip.values.shape
            raise InputError(
                f"{where}: clip '{clip.name}' has the shape {shape} or NaN, where finite (frames, {m}) is allowed."
            )


def check_rig(rig: Rig, tolerance_mm: float = 1e-3) -> Rig:
    """Return the rig, if its function gives finite vertices of the right shape, and the neutral at the default pose.

    Raises InputError, naming the first vertex that is off.
    """
    n = len(rig.mesh.neutral)
    found = np.asarray(rig.function(rig.default[None]), np.float32)
    if found.shape != (1, n, 3):
        raise InputError(
            f"rig '{rig.name}': its function gives the shape {found.shape} for one pose, where (1, {n}, 3) is allowed."
        )
    off = np.abs(found[0] - rig.mesh.neutral).max(axis=1)
    bad = np.flatnonzero(~(off <= tolerance_mm))  # NaN counts as off
    if len(bad):
        raise InputError(
            f"rig '{rig.name}': at the default pose vertex {bad[0]} lies {off[bad[0]]:.4g} mm from the neutral, "
            f"where {tolerance_mm:g} mm is allowed."
        )
    return rig


def rig_names() -> tuple[str, ...]:
    """Return the names of the characters that come with the suite, and of those whose folders a variable names."""
    return character_names()


def recipe_files(name_or_recipe: str | Path) -> tuple[Path, ...]:
    """Return the files that a character is made of: its recipe, the clips that this names, and a model's files.

    Raises InputError for a bad recipe or a model that is not there.
    """
    from data_recipes.ict import recipe as ict_recipe
    from data_recipes.ict.model import model_files
    from data_recipes.recipe.reading import load_recipe

    if ict_recipe.is_facekit(name_or_recipe):
        clips = map(Path, ict_recipe.load_recipe(name_or_recipe).clip_files)
        return recipe_file(str(name_or_recipe)), *clips, *model_files()
    return recipe_file(str(name_or_recipe)), *map(Path, load_recipe(name_or_recipe).clip_files)


def build_rig(name_or_recipe: str | Path) -> Rig:
    """Return a character, built from its recipe (some 15 s).

    name_or_recipe: one of `rig_names()`, or the path of a recipe in TOML. Raises InputError for a bad recipe.
    """
    from data_recipes import face_rig
    from data_recipes.ict import facekit_rig
    from data_recipes.ict.recipe import is_facekit

    return facekit_rig.build(name_or_recipe) if is_facekit(name_or_recipe) else face_rig.build(name_or_recipe)


def load_rig(folder: Path) -> Rig:
    """Return the rig that `save_rig` wrote. Raises InputError for a damaged or missing one."""
    from data_recipes import rig_file

    return rig_file.load_rig(Path(folder))


def save_rig(rig: Rig, folder: Path) -> None:
    """Write one of our rigs into a folder (npz and JSON), to be loaded without building it again."""
    from data_recipes import rig_file

    rig_file.save_rig(rig, Path(folder))


def read_clip(rig: Rig, file: Path) -> Float32[np.ndarray, "t m"]:
    """Return the poses (t, m) of a CSV file whose header names controls of the rig; the others keep their defaults.

    Raises InputError, naming file, line and control, for anything else (see clip_file.py).
    """
    from data_recipes.acting import clip_file

    return clip_file.read_clip(file, rig.controls)


def expression_poses(rig: Rig) -> dict[str, Float32[np.ndarray, " m"]]:
    """Return a face's expressions by name, each as parameters (m,) within the controls' ranges; the neutral pose first.

    A rig whose controls have other names than ours, or than ARKit's, has the neutral pose alone.
    """
    from data_recipes.acting.arkit_names import our_pose
    from data_recipes.acting.expressions import EXPRESSIONS, expression
    from data_recipes.acting.motion import pose

    columns = {control.name: index for index, control in enumerate(rig.controls)}
    poses = {"neutral": rig.default}
    for name in EXPRESSIONS:
        amounts = expression(name, columns)
        found = np.clip(pose(columns, amounts) + our_pose(columns, amounts), rig.lower, rig.upper).astype(np.float32)
        if found.any():
            poses[name] = found
    return poses
