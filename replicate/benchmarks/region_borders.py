"""Do the borders of regions show? The regional method's errors on faces that lie in two regions, beside the others."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from replicate.approximation.metrics import normal_error
from replicate.approximation.regional_basis import split_regions
from replicate.approximation.regional_model import load
from replicate.artefacts import built_rig, drawn_samples, rigid_segments
from replicate.artefacts.plan import Plan
from replicate.engine.store import artefact_folder
from replicate.geometry.mesh import Mesh
from replicate.report.results import Row
from replicate.report.tables import Table, round_off

METRICS = ("border_normal_error", "inner_normal_error")  # of faces in two regions, and of all other faces
BATCH = 16  # poses at a time


def vertex_regions(mesh: Mesh, movable: Int[np.ndarray, " v"], count: int) -> Int[np.ndarray, " n"]:
    """Return the region of each vertex of a mesh; -1 for those that are not among the movable ones."""
    region = np.full(len(mesh.neutral), -1)
    for k, members in enumerate(split_regions(mesh.neutral[movable], count)):
        region[movable[members]] = k
    return region


def border_faces(mesh: Mesh, movable: Int[np.ndarray, " v"], regions: int) -> Bool[np.ndarray, "2 f"]:
    """Return which faces of a mesh lie in several regions, and which in a single one; rigid segments' in neither.

    movable: the vertices that the regions share out among themselves.
    """
    corners = vertex_regions(mesh, movable, regions)[mesh.faces]
    moved = (corners >= 0).all(1)
    one = (corners == corners[:, :1]).all(1)
    return np.stack([moved & ~one, moved & one])


def mean_normal_errors(
    mesh: Mesh,
    offsets_of: Callable,
    params: Float[np.ndarray, "p m"],
    truth: Float[np.ndarray, "p n 3"],
    groups: Bool[np.ndarray, "g f"],
) -> Float[np.ndarray, " g"]:
    """Return the mean normal error of some groups of faces over some poses, in degrees; NaN for an empty group.

    offsets_of: parameters (b, m) → offsets (b, n, 3) mm. truth: the true offsets, mm.
    """
    sums, counts = np.zeros(len(groups)), np.zeros(len(groups))
    for start in range(0, len(params), BATCH):
        rows = slice(start, start + BATCH)
        predicted = offsets_of(np.asarray(params[rows]))
        errors = normal_error(mesh.neutral + predicted, mesh.neutral + np.asarray(truth[rows]), mesh.faces)
        for k, group in enumerate(groups):
            sums[k] += np.nansum(errors[:, group])
            counts[k] += np.isfinite(errors[:, group]).sum()
    return np.divide(sums, counts, out=np.full(len(groups), np.nan), where=counts > 0)


def border_rows(like: Sequence[Row], plans: Mapping[str, Plan], stage: Callable, regions: int) -> list[Row]:
    """Return the errors of trained variants on the borders of one split and elsewhere, on the validation poses.

    like: a variant's rows, by which the new ones get their table and profile. plans: change in words → its plan.
    stage: plan → the trained stage. regions: of the split whose borders are meant, for every variant the same.
    """
    rows = []
    for change, plan in plans.items():
        inputs = {one.name: artefact_folder(one.identifier) for one in stage(plan).inputs}
        mesh, samples = built_rig.load_mesh(inputs), drawn_samples.load(inputs)
        groups = border_faces(mesh, _movable(inputs, mesh), regions)
        model = load(artefact_folder(stage(plan).identifier))
        truth = samples.validation_offsets
        means = mean_normal_errors(mesh, model.offsets, samples.validation_params, truth, groups)
        for metric, mean in zip(METRICS, means, strict=True):
            facts = (None, 1, len(truth), like[0].profile, like[0].run)
            rows.append(
                Row(like[0].table, like[0].character, "regional", f"{metric}[{change}]", "deg", float(mean), *facts)
            )
    return rows


def _movable(inputs: Mapping[str, Path], mesh: Mesh) -> Int[np.ndarray, " v"]:
    from replicate.approximation.segments import segment_vertices

    return np.sort(segment_vertices(rigid_segments.load_coarse_segments(inputs, mesh)))


def borders_table(rows: Sequence[Row], changes: Sequence[str]) -> Table:
    """Return the errors of one character's variants on the borders of 16 regions and elsewhere."""
    values = {row.metric: row.value for row in rows}
    body = []
    for change in changes:
        pair = [values.get(f"{metric}[{change}]") for metric in METRICS]
        if None not in pair:
            body.append((change, *(round_off(value, "deg") for value in pair), f"{pair[0] / pair[1]:.2f}"))
    header = ("", "on borders, degrees", "elsewhere, degrees", "ratio")
    note = "The borders are those of the method's regions, for every line: a model of one region has none there."
    return Table(f"Borders of regions: {rows[0].character}", (header,), tuple(body), (note,))
