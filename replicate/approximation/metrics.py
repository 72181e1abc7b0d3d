"""How far an approximated mesh is from the true one: Table 2's two errors, and running statistics of them.

Only one batch of poses is held at a time: a test set of 1,500 poses and 25,000 faces has 37 million angles for each
method.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from replicate.base.progress import Progress
from replicate.geometry.mesh import Mesh, face_vectors

# A histogram's bins are the top 17 bits of a float32: sign, exponent and 8 bits of the mantissa. They are at most 0.4 %
# wide and cover 2⁻²⁰ to 2¹² mm or degrees; other values go to the first or the last bin.
_SHIFT = 15
_BINS_PER_OCTAVE = 1 << (23 - _SHIFT)
_LOWEST = (127 - 20) * _BINS_PER_OCTAVE
_BINS = 32 * _BINS_PER_OCTAVE


def vertex_error(
    predicted: Float[np.ndarray, "*#b n 3"], target: Float[np.ndarray, "*#b n 3"]
) -> Float[np.ndarray, "... n"]:
    """Return the distance of each predicted vertex from the true one, in their unit (Table 2, "distance error")."""
    return np.linalg.norm(predicted - target, axis=-1)


def angle_between(a: Float[np.ndarray, "*#b 3"], b: Float[np.ndarray, "*#b 3"]) -> Float[np.ndarray, "..."]:
    """Return the angle between vectors of any length in degrees; NaN if one of them is zero.

    Eq. 11 has arccos(n·n'), which loses half of its digits near zero and is undefined if rounding makes the product
    exceed 1. atan2(|a × b|, a·b) is the same angle, exact for all sizes.
    """
    ax, ay, az = np.moveaxis(a, -1, 0)
    bx, by, bz = np.moveaxis(b, -1, 0)
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    sine = np.sqrt(x * x + y * y + z * z)
    cosine = ax * bx + ay * by + az * bz
    angle = np.degrees(np.arctan2(sine, cosine))
    return np.where((sine == 0) & (cosine == 0), np.asarray(np.nan, angle.dtype), angle)


def normal_error(
    predicted: Float[np.ndarray, "*#b n 3"], target: Float[np.ndarray, "*#b n 3"], faces: Int[np.ndarray, "f 3"]
) -> Float[np.ndarray, "... f"]:
    """Return the angle between each face's predicted and true normal, in degrees (the terms of Eq. 11).

    If a face has no area in one of the meshes it has no normal there, and its term is NaN. `tally_add` leaves NaN out
    and counts it, as the paper's released evaluation drops such faces; f of Eq. 11 is the number of the others.
    """
    return angle_between(face_vectors(predicted, faces), face_vectors(target, faces))


@dataclass(frozen=True)
class Tally:
    """Running statistics of an error, for each of g groups of elements, such as a segment's vertices.

    total: (g,) float64, sums.
    count: (g,) int64, how many values were summed.
    left_out: (g,) int64, how many were NaN.
    largest: (g,) float64.
    histogram: (g, 8192) int64.

    `tally_add` changes the arrays in place.
    """

    total: np.ndarray
    count: np.ndarray
    left_out: np.ndarray
    largest: np.ndarray
    histogram: np.ndarray


@dataclass(frozen=True)
class Summary:
    """Mean, 95th percentile and maximum of an error over elements and poses, and the number of values."""

    mean: float
    p95: float
    max: float
    count: int
    left_out: int


def new_tally(groups: int) -> Tally:
    """Return an empty tally for that many groups."""
    count, left_out = np.zeros((2, groups), np.int64)
    return Tally(np.zeros(groups), count, left_out, np.zeros(groups), np.zeros((groups, _BINS), np.int64))


def tally_add(tally: Tally, errors: Float[np.ndarray, "b k"], group: Int[np.ndarray, " k"]) -> None:
    """Add the errors of b poses and k elements (≥ 0, or NaN to be left out) to the elements' groups."""
    groups = len(tally.total)
    errors = errors.astype(np.float32, copy=False)
    valid = ~np.isnan(errors)
    values = np.where(valid, errors, np.float32(0))
    counts = np.bincount(group, valid.sum(0), groups).astype(np.int64)
    tally.total[:] += np.bincount(group, values.sum(0, dtype=np.float64), groups)
    tally.count[:] += counts
    tally.left_out[:] += np.bincount(group, minlength=groups) * len(errors) - counts
    np.maximum.at(tally.largest, group, values.max(0, initial=0))
    bins = np.clip((values.view(np.int32) >> _SHIFT) - _LOWEST, 0, _BINS - 1)
    keys = (bins + group.astype(np.int64) * _BINS)[valid]
    tally.histogram[:] += np.bincount(keys, minlength=groups * _BINS).reshape(groups, _BINS)


def summary(tally: Tally, group: int | None = None) -> Summary:
    """Return a group's statistics, or those of all groups together for None; NaN for a group without values.

    Mean and maximum are exact. The percentile is interpolated in a bin that is at most 0.4 % wide.
    """
    rows = slice(None) if group is None else slice(group, group + 1)
    count, left_out = int(tally.count[rows].sum()), int(tally.left_out[rows].sum())
    if count == 0:
        return Summary(np.nan, np.nan, np.nan, 0, left_out)
    largest = float(tally.largest[rows].max())
    p95 = min(_percentile(tally.histogram[rows].sum(0), 0.95), largest)
    return Summary(float(tally.total[rows].sum()) / count, p95, largest, count, left_out)


def _percentile(histogram: np.ndarray, fraction: float) -> float:
    cumulative = np.cumsum(histogram)
    rank = fraction * cumulative[-1]
    k = int(np.searchsorted(cumulative, rank))
    within = (rank - (cumulative[k] - histogram[k])) / histogram[k]
    lower, upper = _edge(k), _edge(k + 1)
    return lower + within * (upper - lower)


def _edge(k: int) -> float:
    if k == 0:
        return 0.0
    return float(np.array([(k + _LOWEST) << _SHIFT], np.int32).view(np.float32)[0])


# Table 2: the vertex and normal error of every method over all unique test poses (§5.1, Eq. 11).

# (params (b, m), truth (b, n, 3)) → vertices (b, n, 3). Only oracles look at the truth.
Predictor = Callable[[np.ndarray, np.ndarray], np.ndarray]

_KINDS = ("vertex", "normal")


@dataclass(frozen=True)
class Errors:
    """One method's errors.

    vertex, normal: tallies whose groups are `group_names`.
    pose_mm, pose_deg: (t,) float64, mean vertex and normal error of each unique test pose.
    """

    vertex: Tally
    normal: Tally
    group_names: tuple[str, ...]
    pose_mm: np.ndarray
    pose_deg: np.ndarray

    def save(self, file: Path) -> None:
        """Write the errors as npz, without pickle."""
        arrays = {f"{kind}_{f.name}": getattr(getattr(self, kind), f.name) for kind in _KINDS for f in fields(Tally)}
        names = np.array(self.group_names)
        np.savez_compressed(file, **arrays, group_names=names, pose_mm=self.pose_mm, pose_deg=self.pose_deg)


def load_errors(file: Path) -> Errors:
    """Read what `Errors.save` wrote."""
    with np.load(file, allow_pickle=False) as stored:
        vertex, normal = (Tally(*(stored[f"{kind}_{f.name}"] for f in fields(Tally))) for kind in _KINDS)
        return Errors(vertex, normal, tuple(stored["group_names"].tolist()), stored["pose_mm"], stored["pose_deg"])


def unique_poses(params: Float[np.ndarray, "t m"]) -> Int[np.ndarray, " u"]:
    """Return the indices of each distinct pose's first appearance, in order ("all unique poses", §5.1)."""
    return np.sort(np.unique(params, axis=0, return_index=True)[1])


def evaluate(
    mesh: Mesh,
    params: Float[np.ndarray, "t m"],
    offsets: Float[np.ndarray, "t n 3"],
    predictors: Mapping[str, Predictor],
    rigid: Iterable[int] = (),
    batch: int = 32,
    progress: Progress | None = None,
) -> dict[str, Errors]:
    """Measure every method on the test poses (§5.1, Eq. 11), a batch at a time.

    params, offsets: the test poses and their true V − V⁰ in mm, perhaps memory-mapped; repeated poses count once.
    predictors: by label; they give all n vertices, rigid segments placed.
    rigid: the rigid segments' indices; their errors go into one group, "rigid".
    batch: poses at a time.
    progress: counts poses.
    """
    names, group = _groups(mesh, rigid)
    face_group = group[mesh.face_segment]
    poses = unique_poses(params)
    errors = {
        label: Errors(new_tally(len(names)), new_tally(len(names)), names, np.zeros(len(poses)), np.zeros(len(poses)))
        for label in predictors
    }
    for start in range(0, len(poses), batch):
        rows = poses[start : start + batch]
        truth = mesh.neutral + np.asarray(offsets[rows], np.float32)
        true_normals = face_vectors(truth, mesh.faces)
        for label, predict in predictors.items():
            predicted = np.asarray(predict(params[rows], truth), np.float32)
            millimetres = vertex_error(predicted, truth)
            degrees = angle_between(face_vectors(predicted, mesh.faces), true_normals)
            tally_add(errors[label].vertex, millimetres, group[mesh.segment])
            tally_add(errors[label].normal, degrees, face_group)
            errors[label].pose_mm[start : start + batch] = millimetres.mean(-1, dtype=np.float64)
            errors[label].pose_deg[start : start + batch] = np.nanmean(degrees, -1, dtype=np.float64)
        if progress is not None:
            progress.update(len(rows))
    return errors


def _groups(mesh: Mesh, rigid: Iterable[int]) -> tuple[tuple[str, ...], np.ndarray]:
    """Return the groups' names and each segment's group: one for each deformable segment, one for all rigid ones."""
    rigid = set(rigid)
    deformable = [s for s in range(len(mesh.segment_names)) if s not in rigid]
    group = np.full(len(mesh.segment_names), len(deformable))
    group[deformable] = np.arange(len(deformable))
    names = tuple(mesh.segment_names[s] for s in deformable)
    return names + (("rigid",) if rigid else ()), group
