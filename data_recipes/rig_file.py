"""Rigs on disk: one npz of arrays and one JSON description, no pickle. A saved rig needs no geometry to be built."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from data_recipes.controls import Control
from data_recipes.deformers.face_chain import LADDER
from data_recipes.deformers.posed_props import RestProp
from data_recipes.face_rig import FaceParts, FaceRig
from data_recipes.function_rig import POINTS
from data_recipes.ict.facekit_nodes import FACEKIT
from data_recipes.rig import Clip, Rig
from data_recipes.shapes.shape_rig import IN_TURN, JOINTED, SHAPES
from replicate.base.exceptions import InputError
from replicate.base.files import write_text
from replicate.geometry.mesh import Mesh

DESCRIPTION, ARRAYS = "rig.json", "rig.npz"
FORMAT = 6
POINT_LABELS = ("landmark_names", "control_point_names", "control_point_regions", "face_mark_regions")
MESH = ("neutral", "faces", "uv", "segment")
CHAINS = {chain.name: chain for chain in (*LADDER.values(), FACEKIT, SHAPES, IN_TURN, JOINTED)}
PROP = ("colours", "vertices", "faces", "index", "weight")


def _flatten(tree: Any, path: str) -> dict[str, np.ndarray]:
    if isinstance(tree, dict):
        return {k: v for name, part in tree.items() for k, v in _flatten(part, f"{path}/{name}").items()}
    return {path: np.asarray(tree)}


def _unflatten(arrays: dict[str, np.ndarray], path: str) -> dict[str, Any]:
    tree: dict[str, Any] = {}
    for key, value in arrays.items():
        if key.startswith(path + "/"):
            *parents, leaf = key.removeprefix(path + "/").split("/")
            branch = tree
            for parent in parents:
                branch = branch.setdefault(parent, {})
            branch[leaf] = value
    return tree


def save_rig(rig: Rig, folder: Path) -> None:
    """Write one of our rigs into a folder; the description goes last, so that half a rig is never loaded.

    Raises InputError for any other rig: its function is code, which can't be stored.
    """
    if not isinstance(rig, FaceRig):
        raise InputError(f"rig '{rig.name}': only rigs built from recipes can be saved, and this one is other code")
    folder.mkdir(parents=True, exist_ok=True)
    arrays = _flatten(rig.face.constants, "constants") | {f"mesh/{name}": getattr(rig.mesh, name) for name in MESH}
    arrays |= {f"props/{i}/{name}": getattr(prop, name) for i, prop in enumerate(rig.face.props) for name in PROP}
    arrays |= {f"clips/{i}": clip.values for i, clip in enumerate(rig.clips or ())}
    arrays |= {name: getattr(rig, name) for name in POINTS} | {"paint": rig.face.paint}
    description = {
        "format": FORMAT,
        "name": rig.name,
        "segment_names": rig.mesh.segment_names,
        "controls": [[c.name, c.lower, c.default, c.upper, c.region] for c in rig.controls],
        **{name: getattr(rig, name) for name in POINT_LABELS},
        "clips": None if rig.clips is None else [clip.name for clip in rig.clips],
        "props": [[prop.name, prop.follow] for prop in rig.face.props],
        "chain": rig.face.chain.name,
        "rigid": rig.face.rigid,
    }
    np.savez(folder / ARRAYS, allow_pickle=False, **arrays)
    write_text(folder / DESCRIPTION, json.dumps(description, indent=1) + "\n")


def load_rig(folder: Path) -> FaceRig:
    """Read a rig that `save_rig` wrote.

    Raises InputError when files are missing, damaged or of another format.
    """
    try:
        about = json.loads((folder / DESCRIPTION).read_text(encoding="utf-8"))
        with np.load(folder / ARRAYS, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        if about["format"] != FORMAT:
            raise InputError(f"{folder / DESCRIPTION}: expected format {FORMAT}, got {about['format']}")
        return _assemble(about, arrays)
    except (OSError, KeyError, TypeError, ValueError, zipfile.BadZipFile) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{folder}: can't read a rig from {DESCRIPTION} and {ARRAYS} here: {error}") from error


def _assemble(about: dict[str, Any], arrays: dict[str, np.ndarray]) -> FaceRig:
    constants = _unflatten(arrays, "constants")
    props = tuple(
        RestProp(name, follow, **{part: arrays[f"props/{i}/{part}"] for part in PROP})
        for i, (name, follow) in enumerate(about["props"])
    )
    if about["chain"] not in CHAINS:
        raise ValueError(f"there is no chain {about['chain']!r}; there are {', '.join(CHAINS)}")
    face = FaceParts(constants, props, arrays["paint"], CHAINS[about["chain"]], tuple(about["rigid"]))
    clips = about["clips"]
    if clips is not None:
        clips = tuple(Clip(name, arrays[f"clips/{i}"]) for i, name in enumerate(clips))
    return FaceRig(
        name=about["name"],
        mesh=Mesh(**{name: arrays[f"mesh/{name}"] for name in MESH}, segment_names=tuple(about["segment_names"])),
        controls=tuple(Control(*control) for control in about["controls"]),
        landmarks=arrays["landmarks"],
        landmark_names=tuple(about["landmark_names"]),
        control_points=arrays["control_points"],
        control_point_names=tuple(about["control_point_names"]),
        control_point_regions=tuple(about["control_point_regions"]),
        face_marks=arrays["face_marks"],
        face_mark_regions=tuple(about["face_mark_regions"]),
        clips=clips,
        face=face,
    )
