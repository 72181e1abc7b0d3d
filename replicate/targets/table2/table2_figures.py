"""Every figure that belongs to Table 2, from a folder of results alone: no cache, no network, no rig."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from replicate.drawing.panels import Words
from replicate.engine.exceptions import InputError
from replicate.engine.paths import PAPER
from replicate.report.cast import characters_of, has_committed_meshes
from replicate.report.notebooks import folder_of
from replicate.report.pose_record import CHOICES, FOLDED, PoseRecord, load_pose, pose_file
from replicate.report.results import Row, read_results
from replicate.report.training_curves import Curve, read_curves
from replicate.targets.figure09.forehead_wrinkles import figure09
from replicate.targets.figure10.error_faces import figure10, picture_name
from replicate.targets.table2.character_part import CURVES, ROWS
from replicate.targets.table2.curves_chart import training_curves
from replicate.targets.table2.error_chart import table2_chart

if TYPE_CHECKING:
    import matplotlib.figure


@dataclass(frozen=True)
class Table2Results:
    """What a folder of results holds for Table 2, and the paper's numbers; poses by character and the rule for them."""

    rows: list[Row]
    paper: list[Row]
    curves: dict[tuple[str, str], Curve]
    poses: dict[str, dict[str, PoseRecord]]

    @property
    def characters(self) -> tuple[str, ...]:
        """The characters that there are results for, in the order of the paper's."""
        return tuple(characters_of(self.rows))


def open_table2(folder: Path) -> Table2Results:
    """Read everything of Table 2 in a folder of results, with those of its poses that are there.

    Raises InputError, naming the file, for what isn't there. The pose whose forehead folds most has to be, of
    characters whose meshes are committed; of others there are numbers and pictures alone.
    """
    rows, poses = read_results(folder / ROWS), {}
    for character in sorted({row.character for row in rows}):
        files = {choice: pose_file(folder, character, choice) for choice in CHOICES}
        needed = (FOLDED,) if has_committed_meshes(character) else ()
        there = {choice: file for choice, file in files.items() if choice in needed or file.is_file()}
        if there:
            poses[character] = {choice: load_pose(file) for choice, file in there.items()}
    return Table2Results(rows, read_results(PAPER / ROWS), read_curves(folder / CURVES), poses)


def open_results(name: str) -> Table2Results:
    """Read the reference results, "reference", or those of your run with the profile of that name."""
    return open_table2(folder_of(name))


def table2_figure_names(results: Table2Results, character: str) -> tuple[str, ...]:
    """Return the file names, without ending, of one character's `table2_figures`, in their order; draws none."""
    faces = (picture_name(record) for record in results.poses[character].values())
    return (f"table2_{character}_chart", *faces, f"figure09_{character}", f"table2_{character}_curves")


def redraw_charts(folder: Path, characters: Collection[str]) -> list[Path]:
    """Draw the charts of some characters anew from a folder's results, which got more seeds; return their files."""
    from replicate.drawing.panels import save_figure

    if not characters:
        return []
    rows, paper, curves = read_results(folder / ROWS), read_results(PAPER / ROWS), read_curves(folder / CURVES)
    files = []
    for name in characters:
        for kind, chart in (
            ("chart", table2_chart(rows, paper, name)),
            ("curves", training_curves(curves, rows, name)),
        ):
            files.append(folder / f"table2_{name}_{kind}.png")
            save_figure(chart[0], files[-1], chart[1])
    return files


def table2_figures(
    results: Table2Results, character: str, limit_deg: float, renderer: str | None = None
) -> Iterator[tuple[str, "matplotlib.figure.Figure", Words]]:
    """Yield (file name without ending, figure, words) of each figure of one character.

    Raises InputError for a character without meshes.
    """
    if character not in results.poses:
        raise InputError(
            f"{character}: its meshes are no part of these results; allowed are {', '.join(results.poses)}"
        )
    chart, *faces, wrinkles, curves = table2_figure_names(results, character)
    yield chart, *table2_chart(results.rows, results.paper, character)
    for name, record in zip(faces, results.poses[character].values(), strict=True):
        yield name, *figure10(record, limit_deg, renderer=renderer)
    yield wrinkles, *figure09(results.poses[character][FOLDED], renderer=renderer)
    yield curves, *training_curves(results.curves, results.rows, character)
