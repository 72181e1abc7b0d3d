"""Table 2: the vertex and normal error of every method over all unique test poses (§5.1, Eq. 11)."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from replicate.approximation.metrics import Tally, angle_between, new_tally, tally_add, vertex_error
from replicate.engine.progress import Progress
from replicate.geometry.mesh import Mesh
from replicate.geometry.normals import face_vectors

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
    progress: Progress | None = None,
) -> dict[str, Errors]:
    """Measure every method on the test poses, a batch at a time.

    params, offsets: the test poses and their true V − V⁰ in mm (memory-mapped, too); a repeated pose is measured once.
    predictors: label → function of (params, true vertices) giving all n vertices, rigid segments placed.
    rigid: the rigid segments' indices; their errors are pooled into one group, "rigid".
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
    """Return the groups' names and each segment's group: one a deformable segment, and one for all rigid ones."""
    rigid = set(rigid)
    deformable = [s for s in range(len(mesh.segment_names)) if s not in rigid]
    group = np.full(len(mesh.segment_names), len(deformable))
    group[deformable] = np.arange(len(deformable))
    names = tuple(mesh.segment_names[s] for s in deformable)
    return names + (("rigid",) if rigid else ()), group
