"""A folder of samples as it is when a command starts: read, and checked against itself before it is used."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from jaxtyping import Float

from data_recipes.controls import Control
from data_recipes.sampled.control_file import CONTROL_FILE, read_controls
from data_recipes.sampled.face_file import FACE_FILE, FaceFile, read_face
from data_recipes.sampled.influence_file import influence_file, read_influence
from data_recipes.sampled.mesh_file import NeutralFile, read_mesh
from data_recipes.sampled.pose_list import PoseList, list_poses
from data_recipes.sampled.segment_charts import check_segments
from data_recipes.sampled.shards import FOLDER, Shard, read_shards, shard_files
from replicate.engine.exceptions import InputError
from replicate.engine.schema import shown
from replicate.engine.user_files import shown_path

SIZE_MM = (50.0, 1000.0)  # the largest side of the box around a neutral face
EXTENT = 2.0  # by which factor the box around a pose may be larger or smaller than the neutral's, in the median pose
AWAY = 0.15  # of the face's size: how far vertices may be from the neutral on average, in the median pose
NEUTRAL = 1e-3  # of the face's size: how far a pose at the defaults may be from the mesh
AT_DEFAULT = 1e-6  # of a control's range: what counts as at the default
LOOKED_AT_BYTES = 200_000_000  # of vertices, before anything else is done


@dataclass(frozen=True)
class SampleFolder:
    """What a folder holds. neutral: the mesh as its file has it. vertices_mm: (n, 3), in our axes, not yet moved.

    moves: which control moves which vertex, (n, m), where the folder says so.
    """

    folder: Path
    face: FaceFile
    controls: tuple[Control, ...]
    neutral: NeutralFile
    vertices_mm: np.ndarray
    shards: tuple[Shard, ...]
    poses: PoseList
    moves: np.ndarray | None

    @property
    def files(self) -> tuple[Path, ...]:
        """All files that its content is in: mesh, controls, shards, and `influence.npy` where it is."""
        return (
            self.folder / self.face.mesh,
            self.folder / CONTROL_FILE,
            *(file for shard in self.shards for file in shard.paths),
            *(influence_file(self.folder) if self.moves is not None else ()),
        )

    @property
    def where(self) -> str:
        """Its shards' folder, for messages."""
        return shown_path(self.folder / FOLDER)


@cache
def open_folder(folder: Path) -> SampleFolder:
    """Return a folder's content, after all checks that take seconds.

    What it holds is read once a process: later shards belong to the next run. `open_folder.cache_clear()` forgets it.
    Raises InputError, naming the file, for a folder that contradicts itself.
    """
    found = read_folder(folder)
    _check_named_once(found.face, folder)
    check_size(found)
    looked_at = 0
    for index, shard in enumerate(found.shards):
        if looked_at > LOOKED_AT_BYTES:
            break
        looked_at += int(np.prod(shard.headers["vertices"].shape)) * shard.headers["vertices"].dtype.itemsize
        check_vertices(found, index, shard.read("vertices"))
    return found


def read_folder(
    folder: Path, face: FaceFile | None = None, shards: Sequence[Path] | None = None, influence: bool = True
) -> SampleFolder:
    """Return a folder's content: its texts, its mesh and the parameters of its poses. Raises InputError as they do.

    face, shards: what `face.toml` says and the files of its shards, where both are known from before. influence:
    whether an `influence.npy` counts.
    """
    face = read_face(folder) if face is None else face
    controls = read_controls(folder)
    file = folder / face.mesh
    neutral = read_mesh(file)
    check_segments(neutral, face.segments, shown_path(file))
    _check_points(face, len(neutral.vertices), folder)
    files = shard_files(folder) if shards is None else shards
    found = read_shards(files, len(controls), len(neutral.vertices))
    limits = (np.array([getattr(c, name) for c in controls]) for name in ("lower", "default", "upper"))
    poses = list_poses(found, shown_path(folder / FOLDER), *limits)
    stated = influence_file(folder) if influence else ()
    moves = read_influence(stated[0], len(neutral.vertices), len(controls)) if stated else None
    return SampleFolder(folder, face, controls, neutral, face.to_ours(neutral.vertices), found, poses, moves)


def size_mm(found: SampleFolder) -> float:
    """Return the largest side of the box around the neutral pose."""
    return float(np.ptp(found.vertices_mm, axis=0).max())


def check_size(found: SampleFolder) -> None:
    """Raise InputError for a face of no face's size: its unit is another one then."""
    size, (least, most) = size_mm(found), SIZE_MM
    if not least <= size <= most:
        allowed = f"{least:g} to {most:g} mm: is its unit another one?"
        raise InputError(
            f'{shown_path(found.folder / FACE_FILE)}: with unit = "{found.face.unit}" the mesh is {size:.4g} mm large: '
            f"allowed are {allowed}"
        )


def check_vertices(found: SampleFolder, index: int, vertices: Float[np.ndarray, "t n 3"]) -> None:
    """Raise InputError for bad vertices of a shard, of that index among the folder's.

    They are not finite, of another size or order than the mesh's, or at all defaults another shape than the mesh.
    """
    shard, size = found.shards[index], size_mm(found) / found.face.mm  # in the file's unit
    where = f"{found.where}/{shard.name}"
    if not np.isfinite(vertices).all():
        pose, vertex, _ = np.argwhere(~np.isfinite(vertices))[0]
        value = vertices[pose, vertex].tolist()
        raise InputError(f"{where}: vertices[{pose}, {vertex}] is {value}: allowed are finite numbers")
    neutral = found.neutral.vertices
    extent = np.median(np.ptp(vertices.astype(np.float64), axis=1).max(axis=1))
    if not size / EXTENT <= extent <= size * EXTENT:
        raise InputError(
            f"{where}: its poses are {extent / size:.3g} times as large as the mesh: allowed are positions in the "
            "mesh's own unit"
        )
    some = np.linspace(0, len(vertices) - 1, min(32, len(vertices))).astype(int)
    offsets = vertices[some].astype(np.float64) - neutral
    away = np.median(np.linalg.norm(offsets - np.median(offsets, axis=1, keepdims=True), axis=2).mean(axis=1))
    if away > AWAY * size:
        raise InputError(
            f"{where}: a vertex is {away / size:.0%} of the face's size from its place in the mesh on average: allowed "
            f"are {AWAY:.0%}, in the mesh's own axes and order of vertices"
        )
    own = found.poses.params[found.poses.shard == index]
    default = np.array([control.default for control in found.controls])
    ranges = np.array([control.upper - control.lower for control in found.controls])
    for pose in np.flatnonzero((np.abs(own - default) <= AT_DEFAULT * ranges).all(axis=1)):
        off = np.abs(vertices[pose].astype(np.float64) - neutral).max(axis=1)
        if off.max() > NEUTRAL * size:
            raise InputError(
                f"{where}: pose {pose} is at all defaults, and its vertex {off.argmax()} is {off.max() / size:.2%} of "
                f"the face's size from the mesh: allowed are {NEUTRAL:.1%}"
            )


def _check_named_once(face: FaceFile, folder: Path) -> None:
    """Raise InputError for a landmark or a control point that is there twice, the mesh's first vertex too.

    `Points` refuses the others by themselves.
    """
    every = [vertex for vertices in face.points.control_points.values() for vertex in vertices]
    for name, vertices in (("landmarks", face.points.landmarks), ("control_points", every)):
        twice = [vertex for vertex in vertices if vertices.count(vertex) > 1]
        if twice:
            raise InputError(
                f"{shown_path(folder / FACE_FILE)}: points, {name}: found vertex {twice[0]} twice: allowed is once"
            )


def _check_points(face: FaceFile, count: int, folder: Path) -> None:
    every = {"landmarks": face.points.landmarks, **face.points.control_points}
    for name, vertices in every.items():
        if too_large := next((vertex for vertex in vertices if vertex >= count), None):
            raise InputError(
                f"{shown_path(folder / FACE_FILE)}: points, {shown(name)}: found vertex {too_large}: allowed are 0 to "
                f"{count - 1}"
            )
