"""The errors of Figure 13 as rows of results: every way to move every new mesh, aligned and not."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from replicate.report.results import Row
from replicate.report.run_name import run_name
from replicate.targets.figure13.moved_meshes import Mean

TABLE = "figure13"


def rows_of(character: str, profile: str, inputs: Mapping[str, Path], means: Sequence[Mean]) -> list[Row]:
    """Return two rows a mean error: vertex_error_mean[mesh] in mm and normal_error_mean[mesh] in degrees.

    Errors with charts that are off have a second bracket, [shift 2 px] in pixels of the coarse maps or [turn 5 deg].
    """
    rows, run = [], run_name(inputs)
    for mean in means:
        where = f"[{mean.mesh}]" + (f"[{mean.charts}]" if mean.charts else "")
        for kind, unit, value in (("vertex", "mm", mean.distance_mm), ("normal", "deg", mean.normal_deg)):
            facts = (unit, value, None, 1, mean.poses, profile, run)
            rows.append(Row(TABLE, character, mean.method, f"{kind}_error_mean{where}", *facts))
    return rows
