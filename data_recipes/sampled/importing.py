"""From a folder of samples to a rig: the mesh in mm and in its place, its charts and points, all poses in one place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float64

from data_recipes.known_poses import INT16_MAX, KnownPoses, create
from data_recipes.rig import Clip
from data_recipes.sampled.chosen_points import CONTROL_POINTS, LANDMARKS, POSES, motion_mm, regions_of, spread_out
from data_recipes.sampled.face_file import FaceFile
from data_recipes.sampled.influence_file import INFLUENCE_FILE
from data_recipes.sampled.sample_folder import NEUTRAL, SampleFolder, check_size, check_vertices, read_folder
from data_recipes.sampled.sampled_rig import SampledRig
from data_recipes.sampled.segment_charts import make_mesh
from replicate.engine.exceptions import InputError
from replicate.engine.user_files import shown_path

EYES_MM = (0.0, 0.0, 62.0)  # where the middle between the eyes is on our own heads, and the cameras know it
# Of a face that doesn't say where its eyes are: the teen's width, top and front, in proportion to the width.
WIDTH_MM, TOP_MM, FRONT_MM = 194.0, 118.0, 110.0


@dataclass(frozen=True)
class SampledRecipe:
    """What a sampled rig is made from, besides its files: what `face.toml` says, and the version of their reading."""

    face: FaceFile


def import_rig(
    recipe: SampledRecipe, files: Sequence[Path], target: Path, progress: Callable | None = None
) -> SampledRig:
    """Return the rig of a folder's files (mesh, controls, shards …); its poses are written into a folder `target`.

    progress: (total, label, initial) → a context manager with update(k). Raises InputError, naming file, pose and
    vertex, for vertices that are not finite or not of this mesh, and for two poses with the same parameters that
    differ.
    """
    mesh_file, _, *others = files
    shards = [file for file in others if file.name != INFLUENCE_FILE]
    found = read_folder(mesh_file.parent, recipe.face, shards, influence=len(shards) < len(others))
    check_size(found)
    shift = placement(found.vertices_mm, recipe.face)
    mesh = make_mesh(found.neutral, recipe.face.segments, found.vertices_mm + shift, shown_path(mesh_file))
    known = _read_poses(found, target, progress)
    _check_repeated(found, known)
    values = known.frame_params[:] if found.poses.clips else None
    starts = np.cumsum([0, *(length for _, length in found.poses.clips)])
    clips = tuple(
        Clip(name, np.array(values[start : start + length]))
        for (name, length), start in zip(found.poses.clips, starts, strict=False)
    )
    landmarks, points, regions = _points(found, mesh.neutral, known)
    face = recipe.face
    return SampledRig(
        face.name,
        mesh,
        found.controls,
        landmarks,
        points,
        regions,
        clips or None,
        known,
        face.frames_per_second,
        face.source,
        face.licence,
        moves=found.moves,
    )


def placement(vertices_mm: Float[np.ndarray, "n 3"], face: FaceFile) -> Float64[np.ndarray, " 3"]:
    """Return by how much a face is moved, so that its eyes are where the cameras expect them. Nothing is turned."""
    if face.eyes:
        return np.array(EYES_MM) - face.to_ours(np.array(face.eyes))
    low, high = vertices_mm.min(axis=0), vertices_mm.max(axis=0)
    scale = (high[0] - low[0]) / WIDTH_MM
    return np.array([-(low[0] + high[0]) / 2, TOP_MM * scale - high[1], FRONT_MM * scale - high[2]])


def _read_poses(found: SampleFolder, target: Path, progress: Callable | None) -> KnownPoses:
    """Read all shards, once, and put each pose where it belongs: frames as they are, drawn poses rounded (D4)."""
    poses, n = found.poses, len(found.vertices_mm)
    frames, drawn = (poses.frames, poses.drawn) if poses.clips else (poses.drawn, poses.frames)
    known = create(target, len(frames), len(drawn), n, len(found.controls))
    known.frame_params[:], known.drawn_params[:] = poses.params[frames], poses.params[drawn]
    if poses.clips:
        known.drawn_source[:] = poses.source
    place = np.empty(len(poses.params), np.int64)
    place[frames], place[drawn] = np.arange(len(frames)), np.arange(len(drawn))
    is_frame = np.zeros(len(poses.params), bool)
    is_frame[frames] = True
    with progress(len(place), "poses", 0) if progress else nullcontext() as bar:
        for index, shard in enumerate(found.shards):
            vertices = shard.read("vertices")
            check_vertices(found, index, vertices)
            for pose in np.flatnonzero(poses.shard == index):
                own = found.face.to_ours(vertices[poses.row[pose]].astype(np.float64)) - found.vertices_mm
                if is_frame[pose]:
                    known.frame_offsets[place[pose]] = own
                else:
                    step = max(np.float32(np.abs(own).max() / INT16_MAX), np.float32(1e-9))
                    known.drawn_steps[place[pose]] = step
                    known.drawn_whole[place[pose]] = np.clip(np.rint(own / step), -INT16_MAX, INT16_MAX)
                if bar is not None:
                    bar.update(1)
    return known


def _check_repeated(found: SampleFolder, known: KnownPoses) -> None:
    """Raise InputError for two poses with the same parameters whose vertices differ: no function gives these."""
    tolerance = NEUTRAL * float(np.ptp(found.vertices_mm, axis=0).max())
    for k, params in enumerate([*known.frame_params, *known.drawn_params]):
        first = known.find(params)
        if first != k:
            off = float(np.abs(known.offsets(k) - known.offsets(first)).max())
            if off > tolerance:
                raise InputError(
                    f"{found.where}: two poses have the same parameters and vertices that differ by {off:.3g} mm: "
                    f"allowed are {tolerance:.2g} mm; does the face depend on more than its controls?"
                )


def _points(
    found: SampleFolder, neutral: np.ndarray, known: KnownPoses
) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Return landmarks, control points and these' regions: as `face.toml` has them, or by the rule."""
    own = found.face.points
    some = np.unique(np.linspace(0, len(known.frame_params) - 1, POSES).astype(int))
    offsets = np.asarray(known.frame_offsets[some])
    motion = motion_mm(offsets)
    landmarks = np.array(own.landmarks or spread_out(neutral, motion, LANDMARKS), np.int32)
    if own.control_points:
        pairs = [(vertex, region) for region, vertices in own.control_points.items() for vertex in vertices]
        return landmarks, np.array([vertex for vertex, _ in pairs], np.int32), tuple(region for _, region in pairs)
    points = spread_out(neutral, motion, CONTROL_POINTS)
    default = np.array([control.default for control in found.controls])
    regions = [control.region for control in found.controls]
    return landmarks, points, regions_of(known.frame_params[some] - default, offsets[:, points], regions)
