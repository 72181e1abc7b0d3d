"""A method's errors as rows of Table 2: over the whole mesh, and segment by segment."""

from collections.abc import Mapping

from replicate.approximation.evaluation import Errors
from replicate.approximation.metrics import summary
from replicate.report.results import Row


def error_rows(character: str, errors: Mapping[str, Errors], profile: str, run: str, seeds: int = 1) -> list[Row]:
    """Return Table 2's rows, and those of "table2_segments" as metric[segment]."""
    rows = []
    for label, error in errors.items():
        numbers = [("table2", "normal_faces_left_out", "count", summary(error.normal).left_out)]
        for group in (None, *range(len(error.group_names))):
            table = "table2" if group is None else "table2_segments"
            suffix = "" if group is None else f"[{error.group_names[group]}]"
            for kind, unit, tally in (("vertex", "mm", error.vertex), ("normal", "deg", error.normal)):
                statistics = summary(tally, group)
                for name in ("mean", "p95", "max") if statistics.count else ():
                    numbers.append((table, f"{kind}_error_{name}{suffix}", unit, getattr(statistics, name)))
        for table, metric, unit, value in numbers:
            poses = len(error.pose_mm)
            rows.append(Row(table, character, label, metric, unit, float(value), None, seeds, poses, profile, run))
    return rows
