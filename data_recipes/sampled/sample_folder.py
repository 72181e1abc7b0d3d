"""A folder of samples as it is when a command starts: read, and checked against itself before it is used."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32, Int

from data_recipes.controls import Control
from data_recipes.sampled.face_file import (
    CONTROL_FILE,
    FACE_FILE,
    FaceFile,
    influence_file,
    read_controls,
    read_face,
    read_influence,
)
from data_recipes.sampled.mesh_file import NeutralFile, read_mesh
from data_recipes.sampled.segment_charts import check_segments
from data_recipes.sampled.shards import FOLDER, Shard, read_shards, shard_files
from replicate.base.exceptions import InputError
from replicate.base.schema import shown
from replicate.base.user_files import shown_path

# The poses of all shards as one list: their parameters, and which of them are frames of clips, in their order.

FARTHEST = 1_000.0  # ranges that a parameter may be from its default; Eq. 5 reaches three
MOST_POSES = 2_000_000
LEAST_POSES = 20  # frames, or where there are none, poses
NO_SOURCE = -1


@dataclass(frozen=True)
class PoseList:
    """The t poses of some shards.

    shard, row: (t,) where each is. params: (t, m). clips: (name, number of frames) of each clip, in order. frames: the
    poses that are frames of these, one clip after the other. drawn: all other poses; source: of each of those the
    place in `frames` of what it was drawn from, or NO_SOURCE. numbers: of each frame, in its clip.
    """

    shard: Int[np.ndarray, " t"]
    row: Int[np.ndarray, " t"]
    params: Float32[np.ndarray, "t m"]
    clips: tuple[tuple[str, int], ...]
    frames: Int[np.ndarray, " a"]
    numbers: Int[np.ndarray, " a"]
    drawn: Int[np.ndarray, " d"]
    source: Int[np.ndarray, " d"]


def list_poses(
    shards: Sequence[Shard], where: str, lower: np.ndarray, default: np.ndarray, upper: np.ndarray
) -> PoseList:
    """Return the poses of some shards.

    Raises InputError, beginning with `where`, for parameters that are not finite or farther from their defaults than
    anyone would set them, for frames that are there twice, and for too few or too many poses.
    """
    total = sum(shard.poses for shard in shards)
    if total > MOST_POSES:
        raise InputError(f"{where}: found {total:,} poses: allowed are {MOST_POSES:,} at most")
    params, clip, frame, drawn = [], [], [], []
    for shard in shards:
        params.append(_params(shard, where, lower, default, upper))
        has_clip = "clip" in shard.headers
        clip += shard.read("clip").tolist() if has_clip else [""] * shard.poses
        frame.append(_whole(shard, where) if has_clip else np.zeros(shard.poses, np.int64))
        is_drawn = shard.read("drawn") if "drawn" in shard.headers else np.zeros(shard.poses, bool)
        drawn.append(is_drawn)
    names = np.array(clip, dtype=str)
    frame, drawn = np.concatenate(frame), np.concatenate(drawn)
    of_clip = (names != "") & ~drawn
    frames = np.flatnonzero(of_clip)
    order = sorted(dict.fromkeys(names[frames].tolist()), key=_natural)
    rank = {name: k for k, name in enumerate(order)}
    frames = frames[np.lexsort((frame[frames], [rank[name] for name in names[frames].tolist()]))]
    keys = [(names[k], int(frame[k])) for k in frames]
    place = {key: k for k, key in enumerate(keys)}
    if len(place) < len(keys):
        twice = next(key for k, key in enumerate(keys) if place[key] != k)
        raise InputError(f"{where}: frame {twice[1]} of clip {shown(str(twice[0]))} is there twice: allowed is once")
    lengths = [(name, int((names[frames] == name).sum())) for name in order]
    others = np.flatnonzero(~of_clip)
    source = [place.get((names[k], int(frame[k])), NO_SOURCE) if names[k] != "" else NO_SOURCE for k in others]
    count, what = (len(frames), "frames of clips") if len(frames) else (len(others), "poses")
    if count < LEAST_POSES:
        raise InputError(f"{where}: found {count} {what}: allowed are {LEAST_POSES} at least")
    return PoseList(
        np.repeat(np.arange(len(shards)), [shard.poses for shard in shards]),
        np.concatenate([np.arange(shard.poses) for shard in shards]),
        np.concatenate(params),
        tuple(lengths),
        frames,
        frame[frames],
        others,
        np.array(source, np.int64),
    )


def _params(shard: Shard, where: str, lower: np.ndarray, default: np.ndarray, upper: np.ndarray) -> np.ndarray:
    params = shard.read("params").astype(np.float64)
    bad = np.argwhere(~(np.abs(params - default) <= FARTHEST * (upper - lower).astype(np.float64)))  # True for NaN too
    if len(bad):
        pose, control = bad[0]
        value = shown(float(params[pose, control]))
        allowed = f"finite numbers within {FARTHEST:g} ranges of the default"
        raise InputError(f"{where}/{shard.name}: params[{pose}, {control}] is {value}: allowed are {allowed}")
    return params.astype(np.float32) + np.float32(0)  # −0 → +0


def _whole(shard: Shard, where: str) -> np.ndarray:
    frame = shard.read("frame")
    bad = np.flatnonzero((frame < 0) | (frame > 10**9))
    if len(bad):
        raise InputError(
            f"{where}/{shard.name}: frame[{bad[0]}] is {frame[bad[0]]}: allowed are 0 to a thousand million"
        )
    return frame.astype(np.int64)


def _natural(name: str) -> list:
    """Return what sorts names with numbers in them as people do: 2 before 10."""
    return [
        (int(part), "") if part.isdecimal() and part.isascii() else (-1, part) for part in re.split(r"([0-9]+)", name)
    ]


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
