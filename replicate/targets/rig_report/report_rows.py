"""One character's rows of the rig report: held-out errors, components, controls a vertex, interaction, map sizes."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from replicate.approximation.metrics import summary
from replicate.artefacts import built_rig, control_influence, rigid_segments
from replicate.report.error_rows import error_rows
from replicate.report.results import Row
from replicate.report.run_name import run_name
from replicate.targets.rig_report import control_pairs, map_resolution, regressions
from replicate.targets.rig_report.report_numbers import ReportNumbers

if TYPE_CHECKING:
    import replicate.approximation.evaluation
    import replicate.approximation.interaction

TABLE, SEGMENTS = "rig_report", "rig_report_segments"
LIMIT_MM = 0.1  # a pair whose mixed difference is larger somewhere interacts


@dataclass(frozen=True)
class Entry:
    """A number: what it is of, what it says, and on how many poses it stands."""

    method: str
    metric: str
    unit: str
    value: float
    poses: int | None = None
    segment: str = ""


def rows_of(settings: ReportNumbers, inputs: Mapping[str, Path]) -> list[Row]:
    """Return a character's rows.

    inputs: the folders of the stages "rig", "influence", "rigid", "rig_fits", "rig_pairs" and "rig_maps".
    """
    run = run_name(inputs)
    rows = [
        replace(row, table=row.table.replace("table2", TABLE))
        for row in error_rows(settings.character, regressions.load_errors(inputs), settings.profile, run)
    ]
    mesh, influence = built_rig.load_mesh(inputs), control_influence.load(inputs)
    segments = rigid_segments.load_coarse_segments(inputs, mesh)
    entries = [
        *_fit_entries(regressions.load_facts(inputs)),
        *_control_entries(influence, {segment.name: segment.vertices for segment in segments}),
        *_pair_entries(control_pairs.load(inputs)),
        *_map_entries(map_resolution.load(inputs), {segment.name: len(segment.vertices) for segment in segments}),
    ]
    return rows + [_row(entry, settings, run) for entry in entries]


def _row(entry: Entry, settings: ReportNumbers, run: str) -> Row:
    table, metric = (SEGMENTS, f"{entry.metric}[{entry.segment}]") if entry.segment else (TABLE, entry.metric)
    facts = (entry.unit, float(entry.value), None, 1, entry.poses, settings.profile, run)
    return Row(table, settings.character, entry.method, metric, *facts)


def _fit_entries(facts: dict) -> Iterator[Entry]:
    """Yield what the fits are made of; a count of components that more than all would reach is left out."""
    for name, features in facts["features"].items():
        yield Entry(name, "features", "count", features)
        yield Entry(name, "samples", "count", facts["samples"])
        yield Entry(name, "strength", "ratio", facts["strengths"][name])
    yield Entry("basis", "components", "count", facts["components"])
    for share, count in facts["of_variance"].items():
        if count is not None:
            yield Entry("basis", f"components[{share} % of variance]", "count", count)
    for limit, count in facts["within_deg"].items():
        if count is not None:
            yield Entry("basis", f"components[{limit} degrees]", "count", count, facts["component_poses"])


def _control_entries(influence: np.ndarray, vertices: Mapping[str, np.ndarray]) -> Iterator[Entry]:
    """Yield how many controls move a vertex, over all vertices and over each segment's."""
    counts = influence.sum(1)
    yield Entry("influence", "controls", "count", influence.shape[1])
    for name, members in {"": slice(None), **vertices}.items():
        for statistic in ("mean", "median", "max"):
            value = float(getattr(np, statistic)(counts[members]))
            yield Entry("influence", f"controls_per_vertex_{statistic}", "count", value, segment=name)


def _pair_entries(pairs: "replicate.approximation.interaction.Interaction") -> Iterator[Entry]:
    poses = len(pairs.mixed_mm)
    if not poses:
        return  # of a rig that can't be tried
    yield Entry("pairs", "pairs", "count", len(pairs.pairs))
    kinds = {"": slice(None), "[default]": slice(0, 1), "[animation]": slice(1, None)}
    for kind, rows in kinds.items():
        count = len(range(poses)[rows])
        if count:
            yield Entry("pairs", f"interacting_share{kind}", "ratio", pairs.share_above(LIMIT_MM, rows), count)
            yield Entry("pairs", f"mixed_over_single{kind}", "ratio", pairs.ratio(rows), count)
    if len(pairs.pairs):
        yield Entry("pairs", "mixed_difference_max", "mm", pairs.mixed_mm.max(), poses)


def _map_entries(
    floors: "Mapping[int, replicate.approximation.evaluation.Errors]", vertices: Mapping[str, int]
) -> Iterator[Entry]:
    """Yield the mean errors of each map size and the vertices that share a texel, on the whole and by segment."""
    for size, errors in floors.items():
        poses, groups = len(errors.pose_mm), {"": None, **{n: k for k, n in enumerate(errors.group_names)}}
        for name, group in groups.items():
            for kind, unit, tally in (("vertex", "mm", errors.vertex), ("normal", "deg", errors.normal)):
                statistics = summary(tally, group)
                if statistics.count:
                    yield Entry("maps", f"{kind}_error_mean[{size}]", unit, statistics.mean, poses, name)
        for name, count in vertices.items():
            yield Entry("maps", f"vertices_per_texel[{size}]", "ratio", count / size**2, segment=name)
        texels = len(vertices) * size**2
        yield Entry("maps", f"vertices_per_texel[{size}]", "ratio", sum(vertices.values()) / texels)
