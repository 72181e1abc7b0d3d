"""Every figure that belongs to Table 2, from a folder of results alone: no cache, no network, no rig."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from replicate.drawing.panels import Words
from replicate.engine.paths import PAPER
from replicate.report.notebooks import folder_of
from replicate.report.pose_record import PoseRecord, load_pose
from replicate.report.results import Row, read_results
from replicate.report.training_curves import Curve, read_curves
from replicate.targets.table2.character_part import CURVES, ROWS, pose_file
from replicate.targets.table2.curves_chart import training_curves
from replicate.targets.table2.error_chart import table2_chart
from replicate.targets.table2.figure09 import figure09
from replicate.targets.table2.figure10 import figure10


@dataclass(frozen=True)
class Table2Results:
    """What a folder of results holds for Table 2, and the paper's numbers; poses by character."""

    rows: list[Row]
    paper: list[Row]
    curves: dict[tuple[str, str], Curve]
    poses: dict[str, PoseRecord]

    @property
    def characters(self) -> tuple[str, ...]:
        """The characters that there are results for, sorted."""
        return tuple(sorted({row.character for row in self.rows}))


def open_table2(folder: Path) -> Table2Results:
    """Read everything of Table 2 in a folder of results. Raises InputError, naming the file, for what isn't there."""
    rows = read_results(folder / ROWS)
    poses = {
        character: load_pose(pose_file(folder, character)) for character in sorted({row.character for row in rows})
    }
    return Table2Results(rows, read_results(PAPER / ROWS), read_curves(folder / CURVES), poses)


def open_results(name: str) -> Table2Results:
    """Read the reference results, "reference", or those of your run with the profile of that name."""
    return open_table2(folder_of(name))


def table2_figure_names(character: str) -> tuple[str, ...]:
    """Return the file names, without ending, of one character's `table2_figures`, in their order; draws none."""
    return (
        f"table2_{character}_chart",
        f"figure10_{character}",
        f"figure10_{character}_forehead",
        f"figure09_{character}",
        f"table2_{character}_curves",
    )


def table2_figures(
    results: Table2Results, character: str, limit_deg: float, renderer: str | None = None
) -> Iterator[tuple[str, object, Words]]:
    """Yield (file name without ending, figure, words) of each figure of one character."""
    pose = results.poses[character]
    chart, front, forehead, meshes, curves = table2_figure_names(character)
    yield chart, *table2_chart(results.rows, results.paper, character)
    yield front, *figure10(pose, limit_deg, "front", renderer=renderer)
    yield forehead, *figure10(pose, limit_deg, "forehead", renderer=renderer)
    yield meshes, *figure09(pose, renderer=renderer)
    yield curves, *training_curves(results.curves, results.rows, character)
