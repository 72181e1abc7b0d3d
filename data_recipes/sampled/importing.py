"""From a folder of samples to a rig: the mesh in mm and in its place, its charts and points, all poses in one place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float64, Int

from data_recipes.rig import INT16_MAX, Clip, KnownPoses, create
from data_recipes.sampled.face_file import FACE_FILE, INFLUENCE_FILE, FaceFile
from data_recipes.sampled.mesh_file import buffers_of
from data_recipes.sampled.sample_folder import NEUTRAL, SampleFolder, check_size, check_vertices, read_folder, size_mm
from data_recipes.sampled.sampled_rig import SampledRig
from data_recipes.sampled.segment_charts import clean_name, make_mesh
from replicate.base.exceptions import InputError
from replicate.base.spelling import nothing_named
from replicate.base.user_files import shown_path
from replicate.geometry.mesh import Mesh

EYES_MM = (0.0, 0.0, 62.0)  # the middle between the eyes on our own heads, where the cameras look
# For a face that doesn't say where its eyes are: the teen's width, the height of its top and the depth of its front.
WIDTH_MM, TOP_MM, FRONT_MM = 194.0, 118.0, 110.0


@dataclass(frozen=True)
class SampledRecipe:
    """What a sampled rig is made from besides its files: what `face.toml` says."""

    face: FaceFile


def import_rig(
    recipe: SampledRecipe, files: Sequence[Path], target: Path, progress: Callable | None = None
) -> SampledRig:
    """Return the rig of a folder's files (mesh, controls, shards …), and write its poses into the folder `target`.

    progress: (total, label, initial) → a context manager with update(k).
    Raises InputError, naming file, pose and vertex, for vertices that are not finite or not of this mesh, and for two
    poses with the same parameters and different vertices.
    """
    mesh_file, _, *others = files
    influence = any(file.name == INFLUENCE_FILE for file in others)
    apart = {mesh_file.parent / INFLUENCE_FILE, *buffers_of(mesh_file)}
    shards = [file for file in others if file not in apart]
    whole = read_folder(mesh_file.parent, recipe.face, shards, influence)
    check_size(whole)
    first, place = one_of_each(whole)
    found = whole if len(first) == len(place) else merged(whole, first, place)
    shift = placement(found.surface(found.vertices_mm), recipe.face)
    mesh = make_mesh(found.neutral, recipe.face.segments, found.vertices_mm + shift, shown_path(mesh_file))
    known = _read_poses(whole, first, target, progress)
    _check_repeated(found, known)
    values = known.frame_params[:] if found.poses.clips else None
    starts = np.cumsum([0, *(length for _, length in found.poses.clips)])
    clips = tuple(
        Clip(name, np.array(values[start : start + length]))
        for (name, length), start in zip(found.poses.clips, starts, strict=False)
    )
    landmarks, points, regions = _points(found, mesh.neutral, known)
    face = recipe.face
    rigid = segments_named(face.rigid, mesh, shown_path(found.folder / FACE_FILE))
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
        rigid_segments=rigid,
        file_vertices=place.astype(np.int32) if found is not whole else np.zeros(0, np.int32),
    )


def placement(vertices_mm: Float[np.ndarray, "n 3"], face: FaceFile | None = None) -> Float64[np.ndarray, " 3"]:
    """Return the shift that brings a face's eyes to where the cameras expect them."""
    if face and face.eyes:
        return np.array(EYES_MM) - face.to_ours(np.array(face.eyes))
    low, high = vertices_mm.min(axis=0), vertices_mm.max(axis=0)
    scale = (high[0] - low[0]) / WIDTH_MM
    return np.array([-(low[0] + high[0]) / 2, TOP_MM * scale - high[1], FRONT_MM * scale - high[2]])


def segments_named(names: Sequence[str], mesh: Mesh, where: str) -> tuple[str, ...]:
    """Return the mesh's segments that a `face.toml` names as rigid, `where`. Raises InputError for any other name."""
    others = f": there are {', '.join(mesh.segment_names[:20])}"
    for name in names:
        if clean_name(name) not in mesh.segment_names:
            raise InputError(f"{where}: rigid: {nothing_named('segment', name, mesh.segment_names, others)}")
    return tuple(map(clean_name, names))


SAME = 1e-6  # of the face's size: vertices that are no farther apart, at rest and in every pose, are one


def one_of_each(found: SampleFolder) -> tuple[Int[np.ndarray, " u"], Int[np.ndarray, " n"]]:
    """Return the first of all vertices that are one, in their order, and the place among these of each vertex.

    A file has the vertices of a texture's seam twice. Where both move alike in all poses, networks would only tear them
    apart.
    """
    tolerance = SAME * size_mm(found) / found.face.mm
    n, neutral = len(found.vertices_mm), found.neutral.vertices
    _, group = np.unique(np.rint(neutral / tolerance).astype(np.int64), axis=0, return_inverse=True)
    leader = np.full(group.max() + 1, n)
    np.minimum.at(leader, group.ravel(), np.arange(n))
    partner = leader[group.ravel()]  # the first vertex in the same place
    twice = np.flatnonzero(partner != np.arange(n))
    for shard in found.shards if len(twice) else ():
        vertices = shard.read("vertices")
        apart = np.abs(vertices[:, twice].astype(np.float64) - vertices[:, partner[twice]]).max(axis=(0, 2)) > tolerance
        partner[twice[apart]] = twice[apart]
        twice = twice[~apart]
        if not len(twice):
            break
    partner[found.neutral.unused] = found.neutral.unused
    first, place = np.unique(partner, return_inverse=True)
    return first, place.ravel()


def merged(found: SampleFolder, first: Int[np.ndarray, " u"], place: Int[np.ndarray, " n"]) -> SampleFolder:
    """Return a folder's content with vertices that are one, once. first, place: as `one_of_each` gives them."""
    ours = lambda vertices: tuple(dict.fromkeys(place[list(vertices)].tolist()))  # noqa: E731
    neutral, points = found.neutral, found.face.points
    own = {region: ours(vertices) for region, vertices in points.control_points.items()}
    points = replace(points, landmarks=ours(points.landmarks), control_points=own)
    return replace(
        found,
        face=replace(found.face, points=points),
        neutral=replace(
            neutral,
            vertices=neutral.vertices[first],
            faces=place[neutral.faces],
            members={name: list(ours(vertices)) for name, vertices in neutral.members.items()},
        ),
        vertices_mm=found.vertices_mm[first],
        moves=None if found.moves is None else found.moves[first],
    )


def _read_poses(
    found: SampleFolder, kept: Int[np.ndarray, " u"], target: Path, progress: Callable | None
) -> KnownPoses:
    """Read each shard once and put its poses where they belong: frames as they are, drawn poses rounded (D4).

    kept: the vertices that the rig has.
    """
    poses, n, unused = found.poses, len(kept), found.neutral.unused
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
                offsets = found.face.to_ours(vertices[poses.row[pose]].astype(np.float64)) - found.vertices_mm
                offsets[unused] = 0.0
                offsets = offsets[kept]
                if is_frame[pose]:
                    known.frame_offsets[place[pose]] = offsets
                else:
                    step = max(np.float32(np.abs(offsets).max() / INT16_MAX), np.float32(1e-9))
                    known.drawn_steps[place[pose]] = step
                    known.drawn_whole[place[pose]] = np.clip(np.rint(offsets / step), -INT16_MAX, INT16_MAX)
                if bar is not None:
                    bar.update(1)
    return known


def _check_repeated(found: SampleFolder, known: KnownPoses) -> None:
    """Raise InputError for two poses with the same parameters and different vertices: no function gives both."""
    tolerance = NEUTRAL * size_mm(found)
    for k, params in enumerate([*known.frame_params, *known.drawn_params]):
        first = known.find(params)
        if first != k:
            off = float(np.abs(known.offsets(k) - known.offsets(first)).max())
            if off > tolerance:
                raise InputError(
                    f"{found.where}: two poses have the same parameters and vertices that differ by {off:.3g} mm, "
                    f"expected at most {tolerance:.2g} mm; does the face depend on more than its controls?"
                )


def _points(
    found: SampleFolder, neutral: np.ndarray, known: KnownPoses
) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Return landmarks, control points and their regions: from `face.toml`, or where it has none by the rule below."""
    stated = found.face.points
    some = np.unique(np.linspace(0, len(known.frame_params) - 1, POSES).astype(int))
    offsets = np.asarray(known.frame_offsets[some])
    motion = motion_mm(offsets)
    surface = found.in_faces
    chosen = lambda count: surface[spread_out(neutral[surface], motion[surface], count)]  # noqa: E731
    landmarks = np.array(stated.landmarks or chosen(LANDMARKS), np.int32)
    if stated.control_points:
        pairs = [(vertex, region) for region, vertices in stated.control_points.items() for vertex in vertices]
        return landmarks, np.array([vertex for vertex, _ in pairs], np.int32), tuple(region for _, region in pairs)
    points = chosen(CONTROL_POINTS).astype(np.int32)
    default = np.array([control.default for control in found.controls])
    regions = [control.region for control in found.controls]
    return landmarks, points, regions_of(known.frame_params[some] - default, offsets[:, points], regions)


# Landmarks and control points for a face that names none: vertices that are far apart and move a lot.

LANDMARKS, CONTROL_POINTS = 24, 20
LITTLE = 0.1  # of the farthest motion: what moves less, such as a scalp or shoulders, is nothing to drag
STILL_MM = 1e-3  # vertices that move no farther stand still
POSES = 500  # at most so many are looked at
RIDGE = 1e-3  # of the mean square of a column


def motion_mm(offsets: Float[np.ndarray, "b n 3"]) -> Float64[np.ndarray, " n"]:
    """Return how far each vertex moves, the root mean square over poses."""
    return np.sqrt((np.asarray(offsets, np.float64) ** 2).sum(axis=2).mean(axis=0))


def spread_out(neutral: Float[np.ndarray, "n 3"], motion: Float[np.ndarray, " n"], count: int) -> Int[np.ndarray, " k"]:
    """Return up to `count` vertices that move more than the median one, and a tenth of the farthest, far apart.

    Where most vertices stand still, it is the median one of those that move.
    """
    moving = motion > STILL_MM
    few = moving.any() and np.median(motion) <= STILL_MM
    least = max(float(np.median(motion[moving] if few else motion)), LITTLE * float(motion.max()))
    candidates = np.flatnonzero(motion >= least)
    places = np.asarray(neutral[candidates], np.float64)
    chosen = [int(np.argmax(motion[candidates]))]
    distance = ((places - places[chosen[0]]) ** 2).sum(axis=1)
    while len(chosen) < min(count, len(candidates)):
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, ((places - places[chosen[-1]]) ** 2).sum(axis=1))
    return candidates[chosen].astype(np.int32)


def regions_of(
    params: Float[np.ndarray, "b m"], offsets: Float[np.ndarray, "b k 3"], regions: Sequence[str]
) -> tuple[str, ...]:
    """Return for each of k points the region whose controls move it most, by a ridge regression.

    params: differences from the defaults.
    offsets: of the points in these poses.
    regions: of each control.
    """
    x = np.asarray(params, np.float64)
    size = np.sqrt((x**2).mean(axis=0))
    x = x / np.where(size > 0, size, 1.0)
    y = np.asarray(offsets, np.float64).reshape(len(x), -1)
    effects = np.linalg.solve(x.T @ x + RIDGE * len(x) * np.eye(x.shape[1]), x.T @ y)  # (m, 3 k)
    strength = (effects**2).reshape(x.shape[1], -1, 3).sum(axis=2)  # (m, k)
    names = list(dict.fromkeys(regions))
    region_of_control = np.array([names.index(region) for region in regions])
    sums = np.stack([strength[region_of_control == r].sum(axis=0) for r in range(len(names))])  # (r, k)
    return tuple(names[k] for k in sums.argmax(axis=0))
