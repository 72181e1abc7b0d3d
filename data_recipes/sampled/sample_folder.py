"""A folder of samples as it is when a command starts: read, and checked for contradictions before it is used."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32, Int

from data_recipes.controls import Control
from data_recipes.sampled.face_file import (
    CONTROL_FILE,
    FACE_FILE,
    FARTHEST_LIMIT,
    ControlLine,
    FaceFile,
    influence_file,
    read_influence,
)
from data_recipes.sampled.mesh_file import NeutralFile, buffers_of, read_mesh
from data_recipes.sampled.point_caches import (
    control_file,
    controls_of,
    face_of,
    pose_files,
    shards_of,
    spoken_of,
    states_unit,
)
from data_recipes.sampled.segment_charts import check_segments
from data_recipes.sampled.shards import FOLDER, Shard
from replicate.base.exceptions import InputError
from replicate.base.schema import cut, shown
from replicate.base.user_files import shown_path

# The poses of all shards as one list: their parameters, and which of them are frames of clips, in order.

FARTHEST = 1_000.0  # ranges of a control between a parameter and its default; Eq. 5 reaches three
MOST_POSES = 2_000_000
LEAST_POSES = 20  # frames, or poses where there are no frames
NO_SOURCE = -1


@dataclass(frozen=True)
class PoseList:
    """The t poses of some shards.

    shard, row: where each pose is.
    clips: (name, number of frames) of each clip, in order.
    frames: the poses that are frames of these clips, one clip after the other.
    drawn: all other poses.
    source: for each drawn pose the place in `frames` of the frame it was drawn from, or NO_SOURCE.
    """

    shard: Int[np.ndarray, " t"]
    row: Int[np.ndarray, " t"]
    params: Float32[np.ndarray, "t m"]
    clips: tuple[tuple[str, int], ...]
    frames: Int[np.ndarray, " a"]
    drawn: Int[np.ndarray, " d"]
    source: Int[np.ndarray, " d"]


def list_poses(
    shards: Sequence[Shard],
    where: str,
    lower: np.ndarray,
    default: np.ndarray,
    upper: np.ndarray,
    least: int = LEAST_POSES,
) -> PoseList:
    """Return the poses of some shards.

    where: the shards' folder, for messages.
    lower, default, upper: of each control; NaN for a limit that the poses decide.
    least: how many there must be.
    Raises InputError for parameters that are not finite or farther from their defaults than anyone would set them, for
    frames that are there twice, and for too few or too many poses.
    """
    total = sum(shard.poses for shard in shards)
    if total > MOST_POSES:
        raise InputError(f"{where}: expected at most {MOST_POSES:,} poses, got {total:,}")
    # all shards one after the other
    params, clip, frame, drawn = [], [], [], []
    for shard in shards:
        params.append(_params(shard, where, lower, default, upper))
        has_clip = "clip" in shard.headers
        clip += shard.read("clip").tolist() if has_clip else [""] * shard.poses
        frame.append(_frame_numbers(shard, where) if has_clip else np.zeros(shard.poses, np.int64))
        drawn.append(shard.read("drawn") if "drawn" in shard.headers else np.zeros(shard.poses, bool))
    # the frames, clip by clip in natural order
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
        raise InputError(f"{where}: frame {twice[1]} of clip {shown(str(twice[0]))} is there twice, expected once")
    lengths = [(name, int((names[frames] == name).sum())) for name in order]
    # the drawn poses, each with the frame it comes from
    others = np.flatnonzero(~of_clip)
    source = [place.get((names[k], int(frame[k])), NO_SOURCE) if names[k] != "" else NO_SOURCE for k in others]
    count, kind = (len(frames), "frames of clips") if len(frames) else (len(others), "poses")
    if count < least:
        raise InputError(f"{where}: expected at least {least} {kind}, got {count}")
    return PoseList(
        np.repeat(np.arange(len(shards)), [shard.poses for shard in shards]),
        np.concatenate([np.arange(shard.poses) for shard in shards]),
        np.concatenate(params),
        tuple(lengths),
        frames,
        others,
        np.array(source, np.int64),
    )


def _params(shard: Shard, where: str, lower: np.ndarray, default: np.ndarray, upper: np.ndarray) -> np.ndarray:
    params = shard.read("params").astype(np.float64)
    locked, ranges = lower == upper, (upper - lower).astype(np.float64)
    reach = np.where(np.isnan(ranges), FARTHEST_LIMIT, FARTHEST * ranges)
    reach = np.where(locked, AT_DEFAULT * np.maximum(np.abs(default), 1.0), reach)
    bad = np.argwhere(~(np.abs(params - default) <= reach))  # True for NaN too
    if len(bad):
        pose, control = bad[0]
        value = shown(float(params[pose, control]))
        expected = f"expected a finite number within {FARTHEST:g} ranges of the default"
        if locked[control]:
            expected = f"expected {default[control]:g}, as its control has no range"
        raise InputError(f"{where}/{shard.name}: params[{pose}, {control}]: {expected}, got {value}")
    return params.astype(np.float32) + np.float32(0)  # −0 → +0


def _frame_numbers(shard: Shard, where: str) -> np.ndarray:
    frame = shard.read("frame")
    bad = np.flatnonzero(~((frame >= 0) & (frame <= 10**9) & (frame == np.floor(frame))))
    if len(bad):
        expected = "expected a whole number from 0 to 1,000,000,000"
        raise InputError(f"{where}/{shard.name}: frame[{bad[0]}]: {expected}, got {frame[bad[0]]}")
    return frame.astype(np.int64)


def limits_from_poses(
    lines: Sequence[ControlLine], poses: PoseList, where: str
) -> tuple[tuple[Control, ...], Int[np.ndarray, " k"], tuple[str, ...]]:
    """Return the controls that have a range, their columns in `params`, and sentences on what the lines didn't say.

    A limit that a line leaves open is the farthest that frames and poses go, or where only drawn poses move the
    control, these. A control that no pose moves and no line gives a range is left out.
    where: the file, for messages. Raises InputError if all are left out.
    """
    default = np.array([line.default for line in lines])
    acted = np.concatenate([poses.frames, poses.drawn[poses.source == NO_SOURCE]])
    low, high = _reach(poses.params[acted], default)
    lowest, highest = _reach(poses.params, default)
    low, high = np.where(low < high, low, lowest), np.where(low < high, high, highest)
    controls, columns, left_out, taken = [], [], [], []
    for k, line in enumerate(lines):
        lower = float(low[k]) if np.isnan(line.lower) else line.lower
        upper = float(high[k]) if np.isnan(line.upper) else line.upper
        if lower == upper:
            left_out.append(line.name)
            continue
        controls.append(Control(line.name, lower, line.default, upper, line.region))
        columns.append(k)
        if np.isnan(line.lower) or np.isnan(line.upper):
            taken.append(line.name)
    if not controls:
        raise InputError(f"{where}: expected a control that poses move, got none")
    remarks = {"controls that nothing moves, left out": left_out, "limits taken from the poses": taken}
    sentences = tuple(f"{where}: {what}: {cut(', '.join(names))}" for what, names in remarks.items() if names)
    return tuple(controls), np.array(columns), sentences


def _reach(params: np.ndarray, default: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and the largest value of each control, its default included."""
    low, high = params.min(axis=0).astype(np.float64), params.max(axis=0).astype(np.float64)
    near = AT_DEFAULT * np.maximum(np.abs(default), 1.0)  # single precision
    return np.where(low < default - near, low, default), np.where(high > default + near, high, default)


def _natural(name: str) -> list:
    """Return a key that sorts names with numbers in them as people do, 2 before 10."""
    return [
        (int(part), "") if part.isdecimal() and part.isascii() else (-1, part) for part in re.split(r"([0-9]+)", name)
    ]


SIZE_MM = (50.0, 1000.0)  # the largest side of the box around a neutral face
EXTENT = 2.0  # the factor by which the box around the median pose may be larger or smaller than the neutral's
AWAY = 0.15  # of the face's size: the average distance of vertices from the neutral in the median pose, at most
NEUTRAL = 1e-3  # of the face's size: the distance of a pose at the defaults from the mesh, at most
AT_DEFAULT = 1e-6  # of a control's range: a parameter this close to its default is at it
LOOKED_AT_BYTES = 200_000_000  # of vertices that are checked before anything else is done


@dataclass(frozen=True)
class SampleFolder:
    """The content of a folder.

    neutral: the mesh as its file has it.
    vertices_mm: (n, 3), in our axes, not yet shifted.
    moves: (n, m), which control moves which vertex, if the folder has it.
    remarks: sentences on what was left out or filled in.
    """

    folder: Path
    face: FaceFile
    controls: tuple[Control, ...]
    neutral: NeutralFile
    vertices_mm: np.ndarray
    shards: tuple[Shard, ...]
    poses: PoseList
    moves: np.ndarray | None
    remarks: tuple[str, ...]

    @property
    def files(self) -> tuple[Path, ...]:
        """The files of mesh, controls and shards, `influence.npy` if it is used, and buffers that a glTF names."""
        return (
            self.folder / self.face.mesh,
            control_file(self.folder),
            *(file for shard in self.shards for file in shard.paths),
            *(influence_file(self.folder) if self.moves is not None else ()),
            *buffers_of(self.folder / self.face.mesh),
        )

    @property
    def where(self) -> str:
        """The shards' folder, for messages."""
        return shown_path(_shards_folder(self.folder))

    @cached_property
    def in_faces(self) -> Int[np.ndarray, " k"]:
        """The vertices that are in a face."""
        return np.unique(self.neutral.faces)

    def surface(self, vertices: Float[np.ndarray, "*b n 3"]) -> Float[np.ndarray, "*b k 3"]:
        """Return vertices without those that are in no face."""
        return vertices if len(self.in_faces) == vertices.shape[-2] else vertices[..., self.in_faces, :]


@cache
def open_folder(folder: Path) -> SampleFolder:
    """Return a folder's content, after all checks that take seconds.

    A process reads a folder once: shards that come later belong to the next run. `open_folder.cache_clear()` forgets
    the content. Standard error gets a line about whatever is left out. Raises InputError, naming the file, for a folder
    that contradicts itself.
    """
    found = read_folder(folder)
    check_size(found)
    for remark in found.remarks:
        print(remark, file=sys.stderr, flush=True)
    looked_at = 0
    for index, shard in enumerate(found.shards):
        if looked_at > LOOKED_AT_BYTES:
            break
        looked_at += int(np.prod(shard.headers["vertices"].shape)) * shard.headers["vertices"].dtype.itemsize
        check_vertices(found, index, shard.read("vertices"))
    return found


def read_folder(
    folder: Path,
    face: FaceFile | None = None,
    shards: Sequence[Path] | None = None,
    influence: bool = True,
    least: int = LEAST_POSES,
) -> SampleFolder:
    """Return a folder's content, of its poses only the parameters. Raises InputError for what can't be read.

    face, shards: the content of `face.toml` and the shards' files, where they are known already.
    influence: whether to use an `influence.npy`.
    least: how many poses there must be.
    """
    face = face_of(folder) if face is None else face
    lines = controls_of(folder)
    file = folder / face.mesh
    neutral = read_mesh(file, spoken_of(face))
    check_segments(neutral, face.segments, shown_path(file))
    _check_points(face, len(neutral.vertices), folder)
    files = pose_files(folder) if shards is None else shards
    found = shards_of(files, lines, len(neutral.vertices), spoken_of(face))
    limits = (np.array([getattr(line, name) for line in lines]) for name in ("lower", "default", "upper"))
    where = shown_path(_shards_folder(folder))
    poses = list_poses(found, where, *limits, least=least)
    controls, columns, remarks = limits_from_poses(lines, poses, shown_path(folder / CONTROL_FILE))
    poses = replace(poses, params=np.ascontiguousarray(poses.params[:, columns]))
    influence_files = influence_file(folder) if influence else ()
    moves = None
    if influence_files:
        moves = read_influence(influence_files[0], len(neutral.vertices), len(lines))[:, columns]
    if ignored := sorted({name for shard in found for name in shard.ignored}):
        remarks = (*remarks, f"{where}: arrays that no shard needs, left alone: {cut(', '.join(ignored))}")
    return SampleFolder(
        folder,
        face,
        controls,
        neutral,
        face.to_ours(neutral.vertices),
        found,
        poses,
        moves,
        (*neutral.remarks, *remarks),
    )


def _shards_folder(folder: Path) -> Path:
    return folder / FOLDER if (folder / FOLDER).exists() else folder


def size_mm(found: SampleFolder) -> float:
    """Return the largest side of the box around the neutral pose."""
    return float(np.ptp(found.surface(found.vertices_mm), axis=0).max())


def check_size(found: SampleFolder) -> None:
    """Raise InputError for a face that is too small or too large, as with a wrong unit."""
    size, (least, most) = size_mm(found), SIZE_MM
    if not least <= size <= most:
        mesh = found.folder / found.face.mesh
        said = f'{shown_path(found.folder / FACE_FILE)}: with unit = "{found.face.unit}"'
        said = f"{shown_path(mesh)}: with the unit that it states (metersPerUnit)" if states_unit(mesh) else said
        expected = f"expected {least:g} to {most:g} mm: does it have another unit?"
        raise InputError(f"{said} the mesh is {size:.4g} mm large, {expected}")


def check_vertices(found: SampleFolder, index: int, vertices: Float[np.ndarray, "t n 3"]) -> None:
    """Raise InputError if the vertices of a folder's shard don't fit its mesh.

    They are not finite, have another unit, axes or order than the mesh, or differ from it in a pose at all defaults.
    """
    shard, size = found.shards[index], size_mm(found) / found.face.mm  # in the file's unit
    where = f"{found.where}/{shard.name}"
    if not np.isfinite(vertices).all():
        pose, vertex, _ = np.argwhere(~np.isfinite(vertices))[0]
        value = vertices[pose, vertex].tolist()
        raise InputError(f"{where}: vertices[{pose}, {vertex}]: expected finite numbers, got {value}")
    neutral, vertices = found.surface(found.neutral.vertices), found.surface(vertices)
    extent = np.median(np.ptp(vertices.astype(np.float64), axis=1).max(axis=1))
    if not size / EXTENT <= extent <= size * EXTENT:
        raise InputError(
            f"{where}: its poses are {extent / size:.3g} times as large as the mesh: write positions, not offsets, in "
            "the mesh's unit"
        )
    some = np.linspace(0, len(vertices) - 1, min(32, len(vertices))).astype(int)
    offsets = vertices[some].astype(np.float64) - neutral
    away = np.median(np.linalg.norm(offsets - np.median(offsets, axis=1, keepdims=True), axis=2).mean(axis=1))
    if away > AWAY * size:
        raise InputError(
            f"{where}: on average a vertex is {away / size:.0%} of the face's size from its place in the mesh, "
            f"expected at most {AWAY:.0%}: write vertices in the mesh's axes and order"
        )
    params = found.poses.params[found.poses.shard == index]
    default = np.array([control.default for control in found.controls])
    ranges = np.array([control.upper - control.lower for control in found.controls])
    for pose in np.flatnonzero((np.abs(params - default) <= AT_DEFAULT * ranges).all(axis=1)):
        off = np.abs(vertices[pose].astype(np.float64) - neutral).max(axis=1)
        if off.max() > NEUTRAL * size:
            raise InputError(
                f"{where}: pose {pose} is at all defaults, and its vertex {found.in_faces[off.argmax()]} is "
                f"{off.max() / size:.2%} of the face's size from the mesh, expected at most {NEUTRAL:.1%}"
            )


def _check_points(face: FaceFile, count: int, folder: Path) -> None:
    regions = {f"control_points.{shown(name)}": vertices for name, vertices in face.points.control_points.items()}
    for key, vertices in {"landmarks": face.points.landmarks, **regions}.items():
        if too_large := next((vertex for vertex in vertices if vertex >= count), None):
            place = f"{shown_path(folder / FACE_FILE)}: points.{key}"
            raise InputError(f"{place}: expected vertices from 0 to {count - 1}, got {too_large}")
