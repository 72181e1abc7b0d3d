"""Sampled rigs on disk: arrays and one JSON description, no pickle; their poses stay memory-mapped."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import numpy as np

from data_recipes.controls import Control
from data_recipes.known_poses import KnownPoses
from data_recipes.rig import Clip
from data_recipes.sampled.sampled_rig import SampledRig
from replicate.engine.atomic_files import write_text
from replicate.engine.exceptions import InputError
from replicate.geometry.mesh import Mesh

DESCRIPTION, MESH, POINTS, MOVES = "sampled_rig.json", "mesh.npz", "points.npz", "moves.npy"
FORMAT = 2
TEXTS = ("frames_per_second", "source", "licence", "control_point_regions")


def is_sampled(folder: Path) -> bool:
    """Return whether a folder holds a sampled rig."""
    return (folder / DESCRIPTION).is_file()


def save_rig(rig: SampledRig, folder: Path) -> None:
    """Write a rig into the folder that has its poses; the description goes last."""
    rig.mesh.save(folder / MESH)
    np.savez(folder / POINTS, landmarks=rig.landmarks, control_points=rig.control_points)
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
            raise InputError(f"{folder / DESCRIPTION}: format is {about['format']}, where {FORMAT} is allowed.")
        known = KnownPoses.open(folder)
        with np.load(folder / POINTS, allow_pickle=False) as points:
            landmarks, control_points = points["landmarks"], points["control_points"]
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
        )
    except (OSError, KeyError, TypeError, ValueError, zipfile.BadZipFile) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{folder}: found no readable sampled rig ({error}).") from error
