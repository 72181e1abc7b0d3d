"""Table 2: the vertex and normal error of every method over all unique test poses (§5.1, Eq. 11)."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from replicate.approximation.metrics import Tally, angle_between, new_tally, summary, tally_add, vertex_error
from replicate.geometry.mesh import Mesh, face_vectors
from replicate.report.results import Row

# predict(params (b, m), truth (b, n, 3)) -> vertices (b, n, 3). Only oracles look at the truth.
Predictor = Callable[[np.ndarray, np.ndarray], np.ndarray]

_KINDS = ("vertex", "normal")


@dataclass(frozen=True)
class Errors:
    """One method's errors: tallies whose groups are `group_names`, and each pose's own means.

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
    progress=None,
) -> dict[str, Errors]:
    """Measure every method on the test poses, a batch at a time.

    params, offsets: the test poses and their true V − V⁰ in mm (memory-mapped, too); a repeated pose is measured once.
    predictors: label → function of (params, true vertices) giving all n vertices, rigid segments placed.
    rigid: the rigid segments' indices; their errors are pooled into one group, "rigid".
    progress: anything with `.update(poses)`, or None.
    """
    names, group = _groups(mesh, rigid)
    face_group = group[mesh.face_segment]
    poses = unique_poses(params)
    found = {
        label: Errors(new_tally(len(names)), new_tally(len(names)), names, np.zeros(len(poses)), np.zeros(len(poses)))
        for label in predictors
    }
    for start in range(0, len(poses), batch):
        chosen = poses[start : start + batch]
        truth = mesh.neutral + np.asarray(offsets[chosen], np.float32)
        true_normals = face_vectors(truth, mesh.faces)
        for label, predict in predictors.items():
            predicted = np.asarray(predict(params[chosen], truth), np.float32)
            millimetres = vertex_error(predicted, truth)
            degrees = angle_between(face_vectors(predicted, mesh.faces), true_normals)
            errors = found[label]
            tally_add(errors.vertex, millimetres, group[mesh.segment])
            tally_add(errors.normal, degrees, face_group)
            errors.pose_mm[start : start + batch] = millimetres.mean(-1, dtype=np.float64)
            errors.pose_deg[start : start + batch] = np.nanmean(degrees, -1, dtype=np.float64)
        if progress is not None:
            progress.update(len(chosen))
    return found


def _groups(mesh: Mesh, rigid: Iterable[int]) -> tuple[tuple[str, ...], np.ndarray]:
    """Return the groups' names and each segment's group: one a deformable segment, and one for all rigid ones."""
    rigid = set(rigid)
    deformable = [s for s in range(len(mesh.segment_names)) if s not in rigid]
    group = np.full(len(mesh.segment_names), len(deformable))
    group[deformable] = np.arange(len(deformable))
    names = tuple(mesh.segment_names[s] for s in deformable)
    return names + (("rigid",) if rigid else ()), group


def error_rows(character: str, errors: Mapping[str, Errors], profile: str, run: str, seeds: int = 1) -> list[Row]:
    """Return Table 2's rows, and those of "table2_segments" as metric[segment]."""
    rows = []
    for label, found in errors.items():
        numbers = [("table2", "normal_faces_left_out", "count", summary(found.normal).left_out)]
        for group in (None, *range(len(found.group_names))):
            table = "table2" if group is None else "table2_segments"
            suffix = "" if group is None else f"[{found.group_names[group]}]"
            for kind, unit, tally in (("vertex", "mm", found.vertex), ("normal", "deg", found.normal)):
                statistics = summary(tally, group)
                for name in ("mean", "p95", "max") if statistics.count else ():
                    numbers.append((table, f"{kind}_error_{name}{suffix}", unit, getattr(statistics, name)))
        for table, metric, unit, value in numbers:
            poses = len(found.pose_mm)
            rows.append(Row(table, character, label, metric, unit, float(value), None, seeds, poses, profile, run))
    return rows


def texel_rows(character: str, maps: Mapping[str, Mapping[str, tuple[int, int]]], profile: str, run: str) -> list[Row]:
    """Return how many texels of its map each vertex has, per map and for each method as a whole.

    maps: method → {map's name → (map's width in pixels, vertices that read from it)}; coarse maps are named by their
    segment, refinement maps by number.
    """
    rows = []
    for method, sizes in maps.items():
        ratios = {f"[{name}]": width**2 / vertices for name, (width, vertices) in sizes.items()}
        ratios[""] = sum(w**2 for w, _ in sizes.values()) / sum(v for _, v in sizes.values())
        for suffix, ratio in ratios.items():
            table = "table2_segments" if suffix else "table2"
            metric = f"texels_per_vertex{suffix}"
            rows.append(Row(table, character, method, metric, "ratio", ratio, None, None, None, profile, run))
    return rows
