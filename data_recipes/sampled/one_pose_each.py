"""Folders of samples with one pose for each shape, as of sculpts that a program lists: they are faces of shapes.

No pose moves more than one control from its default, so nothing is known of how controls act together, and a network
could learn nothing of it. What a pose adds to the neutral is its control's shape instead.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from data_recipes.sampled.face_file import FaceFile
from data_recipes.sampled.mesh_file import buffers_of
from data_recipes.sampled.point_caches import controls_of, pose_files, shards_of
from data_recipes.sampled.sample_folder import AT_DEFAULT, NEUTRAL, SampleFolder, check_vertices, read_folder, size_mm
from replicate.base.exceptions import InputError
from replicate.base.schema import cut

MOST = 4  # poses of a control, off its default: with more of them it is an animation of this control alone


@cache
def has_one_pose_each(folder: Path) -> bool:
    """Return whether no pose of a folder moves more than one control, and no control has more than `MOST` such poses.

    Only the parameters are read, until a pose decides. A folder that can't be read is none.
    """
    try:
        lines = controls_of(folder)
        default = np.array([line.default for line in lines])
        poses: list[set[int]] = [set() for _ in default]
        for shard in shards_of(pose_files(folder), lines, None):
            steps = _steps(shard.read("params"), default)
            for pose, control in np.argwhere(steps):
                poses[control].add(int(steps[pose, control]))
            if (steps != 0).sum(axis=1).max() > 1 or max(map(len, poses)) > MOST:
                return False
        return any(poses)
    except InputError:
        return False


def _steps(params: Float[np.ndarray, "t m"], default: Float[np.ndarray, " m"]) -> Int[np.ndarray, "t m"]:
    """Return how far controls are from their defaults, in the smallest steps that single precision tells apart."""
    away = (params - default) / (AT_DEFAULT * np.maximum(np.abs(default), 1.0))
    return np.rint(np.nan_to_num(away, nan=1.0).clip(-1e15, 1e15)).astype(np.int64)


@cache
def open_poses(folder: Path, mesh: str) -> SampleFolder:
    """Return a folder's content, checked; standard error gets a line on how it is read, and on what is left out.

    mesh: the name of its neutral's file. A process reads a folder once, as it does other samples.
    """
    found = read_poses((folder / mesh, Path(), *pose_files(folder)))
    named = [shape.control for shape in posed_shapes(found)[1]]
    what = {
        "controls without a pose, left out": [c.name for c in found.controls if c.name not in named],
        "controls with several poses, which go straight from one to the next": sorted(
            {name for name in named if named.count(name) > 1}, key=named.index
        ),
        "clips of such poses, which are no animation: one is invented": [name for name, _ in found.poses.clips],
    }
    remarks = [
        *found.remarks,
        f"{found.where}: no pose moves more than one control, so the face is read as the sum of their shapes; poses "
        "that move several controls at once would make it one of samples",
    ]
    remarks += [f"{found.where}: {words}: {cut(', '.join(names))}" for words, names in what.items() if names]
    for remark in remarks:
        print(remark, file=sys.stderr, flush=True)
    return found


def read_poses(files: Sequence[Path]) -> SampleFolder:
    """Return the content of a folder's files (mesh, controls, shards, buffers), in their own unit and axes.

    Raises InputError, naming the file, for what can't be read.
    """
    mesh, _, *others = files
    apart = buffers_of(mesh)
    shards = [file for file in others if file not in apart]
    as_it_is = FaceFile("face", "mm", "y", mesh.name)
    return read_folder(mesh.parent, as_it_is, shards, influence=False, least=1)


@dataclass(frozen=True)
class Shape:
    """What a control adds, offsets (n, 3) for each `way` that it goes between low and high, from its default."""

    control: str
    offsets: Float[np.ndarray, "n 3"]
    way: float = 1.0
    low: float = -np.inf
    high: float = np.inf


def posed_shapes(found: SampleFolder) -> tuple[Float[np.ndarray, "n 3"], list[Shape]]:
    """Return the neutral and the shapes, in the order of controls.

    A control with one pose has one shape; one with several has one between each two neighbours, the neutral among them,
    and the outermost have no end. The neutral is the first pose at all defaults, which has more digits than the mesh,
    or else the mesh. Raises InputError for vertices that don't fit the mesh, and for two of one pose.
    """
    default, tolerance = np.array([control.default for control in found.controls]), NEUTRAL * size_mm(found)
    rest, poses = None, [{} for _ in found.controls]  # of each control: step → how far from its default, vertices
    for index, shard in enumerate(found.shards):
        vertices, params = shard.read("vertices").astype(np.float64), found.poses.params[found.poses.shard == index]
        check_vertices(found, index, vertices)
        for pose, away, steps in zip(vertices, params - default, _steps(params, default), strict=True):
            if rest is None and not steps.any():
                rest = pose
            for k in np.flatnonzero(steps):
                _, first = poses[k].setdefault(int(steps[k]), (float(away[k]), pose))
                if (off := np.abs(pose - first).max()) > tolerance:
                    twice = f"two poses have {found.controls[k].name} at {default[k] + away[k]:g}"
                    raise InputError(f"{found.where}: {twice} and vertices that differ by {off:.3g}, expected one")
    rest = found.neutral.vertices if rest is None else rest
    shapes = []
    for control, some in zip(found.controls, poses, strict=True):
        knots = sorted([(0.0, rest), *some.values()], key=lambda knot: knot[0])
        ends = [-np.inf, *(away for away, _ in knots[1:-1]), np.inf]
        for ((before, first), (after, second)), limits in zip(pairwise(knots), pairwise(ends), strict=False):
            shapes.append(Shape(control.name, second - first, after - before, *limits))
    return rest, shapes
