"""A rig written as a folder of samples: mesh, controls, `face.toml`, and shards of poses that the caller chooses."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Mapping
from contextlib import nullcontext
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from data_recipes.rig import Rig
from data_recipes.sampled.face_file import CONTROL_FILE, FACE_FILE, HEADER, INFLUENCE_FILE
from data_recipes.sampled.importing import EYES_MM
from data_recipes.sampled.shards import FOLDER, UNFINISHED
from replicate.base.exceptions import InputError
from replicate.base.files import write_text
from replicate.base.user_files import shown_path
from replicate.geometry.mesh import Mesh

MESH_FILE = "mesh.obj"


def write_folder(
    rig: Rig,
    folder: Path,
    total: int,
    shards: Iterable[Mapping[str, np.ndarray]],
    progress: Callable | None = None,
    moves: Bool[np.ndarray, "n m"] | None = None,
) -> None:
    """Write a rig as a folder of samples, `face.toml` last: a folder without it is unfinished.

    folder: empty, or not there yet.
    total: the number of poses.
    shards: the arrays of each, without the vertices, which the rig computes.
    progress: (total, label) → a context manager with update(k).
    moves: which control moves which vertex, for `influence.npy`.
    Raises InputError for a folder with anything in it.
    """
    check_empty(folder)
    (folder / FOLDER).mkdir(parents=True, exist_ok=True)
    write_text(folder / MESH_FILE, _obj(rig.mesh))
    write_text(folder / CONTROL_FILE, _controls(rig))
    if moves is not None:
        np.save(folder / INFLUENCE_FILE, moves)
    with progress(total, "poses") if progress else nullcontext() as bar:
        for k, arrays in enumerate(shards, start=1):
            file = folder / FOLDER / f"{k:05d}.npz"
            with open(f"{file}{UNFINISHED}", "wb") as stream:
                np.savez(stream, **arrays, vertices=rig(arrays["params"]))
            Path(f"{file}{UNFINISHED}").rename(file)
            if bar is not None:
                bar.update(len(arrays["params"]))
    write_text(folder / FACE_FILE, _face(rig))


def check_empty(folder: Path) -> None:
    """Raise InputError unless a folder is empty or not there yet."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{shown_path(folder)} is there already: name an empty folder, or one that doesn't exist yet")


def _face(rig: Rig) -> str:
    regions: dict[str, list[int]] = {}
    for vertex, region in zip(rig.control_points.tolist(), rig.control_point_regions, strict=True):
        regions.setdefault(region, []).append(vertex)
    lines = [
        f'name = "{rig.name}"',
        'unit = "mm"',
        'up = "y"',
        f'mesh = "{MESH_FILE}"',
        'segments = "groups"',
        f"eyes = {list(EYES_MM)}",
        'source = "written by make export-samples"',
        "",
        "[points]",
        f"landmarks = {rig.landmarks.tolist()}",
        "",
        "[points.control_points]",
        *(f"{region} = {vertices}" for region, vertices in regions.items()),
    ]
    return "\n".join(lines) + "\n"


def _controls(rig: Rig) -> str:
    text = io.StringIO()
    rows = ([c.name, repr(c.lower), repr(c.default), repr(c.upper), c.region] for c in rig.controls)
    csv.writer(text, lineterminator="\n").writerows([HEADER, *rows])
    return text.getvalue()


def _obj(mesh: Mesh) -> str:
    """Return the mesh as OBJ, a group for each segment, which also lists its vertices as point elements."""
    lines = ["# the neutral pose in mm; each vertex's texture coordinates are those of its own segment's chart"]
    lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in mesh.neutral.tolist()]
    lines += [f"vt {u:.9g} {v:.9g}" for u, v in mesh.uv.tolist()]
    for k, name in enumerate(mesh.segment_names):
        lines.append(f"g {name}")
        lines.append("p " + " ".join(str(vertex + 1) for vertex in np.flatnonzero(mesh.segment == k)))
        faces = mesh.faces[mesh.face_segment == k] + 1
        lines += ["f " + " ".join(f"{vertex}/{vertex}" for vertex in face) for face in faces.tolist()]
    return "\n".join(lines) + "\n"
