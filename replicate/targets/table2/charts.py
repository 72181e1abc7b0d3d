"""Table 2 in pictures: every figure of it, from a folder of results alone."""

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from replicate.base.exceptions import InputError
from replicate.base.paths import PAPER
from replicate.drawing.panels import (
    DPI,
    LETTER_PT,
    MEASURES,
    WEBP,
    WIDTH,
    Words,
    enlarge,
    error_scale,
    save_figure,
    tidy,
)
from replicate.methods.method_registry import in_order, method_named, methods
from replicate.report.notebooks import folder_of
from replicate.report.pose_record import CHOICES, FOLDED, PoseRecord, load_pose, pose_file
from replicate.report.results import (
    STANDS_FOR,
    Curve,
    Row,
    characters_of,
    find,
    has_committed_meshes,
    read_curves,
    read_results,
)
from replicate.report.tables import Table, our_value, round_off
from replicate.targets.figure09.forehead_wrinkles import figure09
from replicate.targets.figure10 import figure10, picture_name
from replicate.targets.table2.rows import CURVES, ROWS, clips_rows, paper_profile_rows, second_layouts

if TYPE_CHECKING:
    import matplotlib.figure


@dataclass(frozen=True)
class Table2Results:
    """Table 2 in a folder of results, and the paper's numbers. poses: by character and by the rule that chose them."""

    rows: list[Row]
    paper: list[Row]
    curves: dict[tuple[str, str], Curve]
    poses: dict[str, dict[str, PoseRecord]]

    @property
    def characters(self) -> tuple[str, ...]:
        """The characters with results, in the order of the paper's."""
        return tuple(characters_of(self.rows))


def open_table2(folder: Path) -> Table2Results:
    """Read everything of Table 2 in a folder of results, with the poses that are there.

    Raises InputError, naming the file, for a missing one. Poses may be missing, but for that with the most folds of
    characters whose meshes are committed; for others numbers and pictures suffice.
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
    """Return the file names, without ending, of one character's `table2_figures`, in their order."""
    faces = (picture_name(record) for record in results.poses[character].values())
    return (f"table2_{character}_chart", *faces, f"figure09_{character}", f"table2_{character}_curves")


def redraw_charts(folder: Path, characters: Collection[str]) -> list[Path]:
    """Draw the charts of some characters anew from committed results, after seeds were added; return their files."""
    if not characters:
        return []
    rows, paper, curves = read_results(folder / ROWS), read_results(PAPER / ROWS), read_curves(folder / CURVES)
    files = []
    for name in characters:
        for kind, chart in (
            ("chart", table2_chart(rows, paper, name)),
            ("curves", training_curves(curves, rows, name)),
        ):
            files.append(folder / f"table2_{name}_{kind}{WEBP}")
            save_figure(chart[0], files[-1], chart[1])
    return files


def table2_figures(
    results: Table2Results, character: str, limit_deg: float
) -> Iterator[tuple[str, "matplotlib.figure.Figure", Words]]:
    """Yield (file name without ending, figure, words) of each figure of one character.

    Raises InputError for a character without meshes.
    """
    if character not in results.poses:
        raise InputError(f"{character}: these results lack its meshes; they have those of {', '.join(results.poses)}")
    chart, *faces, wrinkles, curves = table2_figure_names(results, character)
    yield chart, *table2_chart(results.rows, results.paper, character)
    for name, record in zip(faces, results.poses[character].values(), strict=True):
        yield name, *figure10(record, limit_deg)
    yield wrinkles, *figure09(results.poses[character][FOLDED])
    yield curves, *training_curves(results.curves, results.rows, character)


# The networks' validation error over training steps, with the floors that their maps set.

FLOORS = {"coarse": "--", "refined": (0, (1, 2))}  # dashes and dots: the two may lie on each other


def training_curves(
    curves: Mapping[tuple[str, str], Curve], rows: Sequence[Row], character: str
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): both errors of one character's networks on the validation poses, step by step.

    rows: Table 2's results, for the floors (dashed and dotted).
    """
    from matplotlib.figure import Figure

    figure = Figure((WIDTH, 4.6), dpi=DPI, layout="constrained")
    ends = []
    for axes, column, (metric, _, label) in zip(figure.subplots(1, 2), (2, 3), MEASURES, strict=True):
        for method in map(method_named, in_order(name for owner, name in curves if owner == character)):
            if method.in_figures:
                curve = curves[character, method.name]
                steps, errors = [row[0] for row in curve], [row[column] for row in curve]
                axes.plot(steps, errors, color=method.colour, linewidth=2.2, label=method.label)
                ends.append(f"{method.label} ends at {curve[-1][column]:.2f} {'mm' if column == 2 else 'degrees'}")
        for floor in methods().values():
            if floor.floor_of and (row := find(rows, "table2", character, floor.name, metric)):
                style = FLOORS.get(floor.floor_of, "--")
                axes.axhline(row.value, color=floor.colour, linestyle=style, linewidth=2, label=floor.label)
        error_scale(axes, "y")
        axes.set_xlim(left=0)
        axes.set_xlabel("training step")
        axes.set_ylabel(label)
        axes.locator_params(axis="x", nbins=4)
        tidy(axes)
        enlarge(axes)
    if ends:  # methods without training alone have no curve
        lines = axes.get_legend_handles_labels()
        rows_of_names = math.ceil(len(lines[0]) / 3)
        figure.set_figheight(4.6 + 0.33 * max(0, rows_of_names - 2))  # or a third one takes the axes' room
        figure.legend(*lines, frameon=False, fontsize=LETTER_PT, ncols=3, loc="outside upper center")
    return figure, Words(
        f"Two line charts of validation error against training step for {character}: {'; '.join(ends)}.",
        f"Error of {character}'s networks on the validation poses as training goes on; the refined network starts "
        "where the coarse one ended. Dashed and dotted: what the maps' resolution allows on the test poses (Table 2's "
        "floors). Validation poses are others than those of Table 2, so the ends differ from its numbers.",
    )


# Table 2 as a chart: our means and the paper's, method by method, so that orderings can be seen.

UNITS = {"mm": "mm", "deg": "degrees"}
OURS, THEIRS = "#333333", "black"
MOST = 14  # of more methods the chart shows the standard ones
LINE, FRAME = 0.37, 1.35  # inches: a method's line, and the space above and below all lines
BESIDE = 9  # points from a mark to its number
AT_THE_END = 3  # a dot above a third of the largest value has its number on the left, unless a ring is there


def table2_chart(ours: Sequence[Row], paper: Sequence[Row], character: str) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): one character's mean errors (dots) and those of its film character (rings).

    The axes are logarithmic, so that ratios can be compared and a large error takes no room from the small ones. The
    neutral pose's errors are in the caption.
    """
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    theirs = STANDS_FOR.get(character, "")
    names = {row.method for row in ours if row.character == character and row.metric == MEASURES[0][0]}
    methods = [method for method in map(method_named, in_order(names)) if method.in_charts]
    if len(methods) > MOST:
        methods = [method for method in methods if method.standard]
    figure = Figure((WIDTH, LINE * len(methods) + FRAME), dpi=DPI, layout="constrained")
    phrases, motion = [], []
    for axes, (metric, unit, label) in zip(figure.subplots(1, 2, sharey=True), MEASURES, strict=True):
        shown = [find(ours, "table2", character, method.name, metric).value for method in methods]
        largest = max(shown, default=0.0)
        # dots and rings
        for y, method in enumerate(methods):
            mine, other = (
                find(rows, "table2", name, method.name, metric) for rows, name in ((ours, character), (paper, theirs))
            )
            text = round_off(mine.value, unit)
            if other:  # larger and below, so that neither mark hides the other
                axes.plot(other.value, y, "o", markerfacecolor="none", markeredgecolor=THEIRS, markersize=13, zorder=2)
            axes.plot(mine.value, y, "o", color=method.colour, markersize=8, zorder=3)
            if mine.sd is not None:
                axes.errorbar(mine.value, y, xerr=mine.sd, color=method.colour, capsize=3)
            left = other.value > mine.value if other else mine.value > largest / AT_THE_END
            _write_beside(axes, text, mine.value, y, -1 if left else 1)
            phrases.append(f"{method.label} {text} {UNITS[unit]}")
        if still := find(ours, "table2", character, "neutral", metric):
            motion.append(f"{round_off(still.value, unit)} {UNITS[unit]}")
        # axes
        axes.set_yticks(range(len(methods)), [method.title for method in methods])
        axes.set_ylim(len(methods) - 0.4, -0.6)
        axes.margins(x=0.34)  # room for numbers on both sides
        axes.set_xlabel(label.replace("normal angle error", "normal error"))
        error_scale(axes)
        tidy(axes)
        enlarge(axes)
    # legend and words
    label = f"{character} (ours)" if theirs else character
    dot = Line2D([], [], marker="o", linestyle="", color=OURS, markersize=8, label=label)
    ring = Line2D([], [], marker="o", linestyle="", color=THEIRS, markersize=13, label=f"{theirs} (the paper’s)")
    ring.set_markerfacecolor("none")
    handles = [dot, ring] if theirs else [dot]
    figure.legend(handles=handles, frameon=False, fontsize=LETTER_PT, ncols=2, loc="outside upper right")
    rings = f" beside the paper's {theirs} (rings), another rig: compare orderings and ratios, not millimetres"
    moved = f" The test poses differ from the neutral one by {' and '.join(motion)} on average." if motion else ""
    return figure, Words(
        f"Two dot charts of mean error by method for {character}: {'; '.join(phrases)}.",
        f"Table 2 as a chart: {character} (dots){rings if theirs else ''}. The axes are logarithmic. "
        f"† ‡ see the true mesh of each test pose.{moved}",
    )


def _write_beside(axes, text: str, value: float, y: int, side: int) -> None:
    """Write a dot's number beside it, on the left (side -1) or the right (1)."""
    align = "left" if side > 0 else "right"
    axes.annotate(text, (value, y), (side * BESIDE, 0), textcoords="offset points", ha=align, va="center")


# The paper's networks with and without a straight line beside them: does the line change their ranking?

PAIRS = {"coarse": "coarse_line", "refined": "refined_line", "dense": "dense_line", "pca": "pca_line"}
LINE_METHOD = "linear"
STUDIED = ("coarse", "refined", "dense", "linear", "regional")  # the methods in charts of studies
RATIOS = (("refined", "coarse"), ("refined", "dense"))  # what claims C1, and C2 and C5, compare
LINE_HEIGHT, LINE_FRAME = 0.36, 1.7  # inches: a network's line, and the space above and below all lines
NOTE = "Linear: the line alone, ridge regression from rig parameters to vertices."


def compared(rows: Sequence[Row], character: str) -> list[str]:
    """Return the networks that a character has both with a line beside them and without."""
    metric = MEASURES[0][0]
    return [name for name, line in PAIRS.items() if all(_error(rows, character, m, metric) for m in (name, line))]


def line_table(rows: Sequence[Row], character: str) -> Table | None:
    """Return both mean errors and the size of each network without and with a line; None if no network has one."""
    networks = compared(rows, character)
    if not networks:
        return None
    metrics = (*(metric for metric, *_ in MEASURES), "model_size")
    body: list[tuple[str, ...] | None] = []
    for name in networks:
        found = [_error(rows, character, method, metric) for metric in metrics for method in (name, PAIRS[name])]
        body.append((method_named(name).label, *(our_value(row, spread=False) for row in found)))
    found = [_error(rows, character, LINE_METHOD, metric) for metric in metrics]
    alone = [our_value(row, spread=False) for row in found]
    body.append((method_named(LINE_METHOD).label, *(cell for value in alone for cell in (value, ""))))
    ratios = [line for above, below in RATIOS if (line := _ratio_line(rows, character, above, below, networks))]
    body += [None, *ratios] if ratios else []
    header = ("", *(f"{unit}{how}" for unit in ("mm", "degrees", "MB") for how in ("", ", with a line")))
    return Table(f"A straight line beside the networks: {character}", (header,), tuple(body), (NOTE,))


def _ratio_line(
    rows: Sequence[Row], character: str, above: str, below: str, networks: Sequence[str]
) -> tuple[str, ...] | None:
    if above not in networks or below not in networks:
        return None
    cells = []
    for metric, *_ in MEASURES:
        for one, other in ((above, below), (PAIRS[above], PAIRS[below])):
            values = [_error(rows, character, method, metric).value for method in (one, other)]
            cells.append(round_off(values[0] / values[1] if values[1] else None, "ratio"))
    return (f"{method_named(above).label} / {method_named(below).label}", *cells, "", "")


def line_chart(rows: Sequence[Row]) -> "tuple[matplotlib.figure.Figure, Words] | None":
    """Return (figure, words): an arrow for each network of each character, from its error alone to that with a line.

    A cross is the line alone. None if no network has a line beside it.
    """
    groups = [(character, name) for character in characters_of(rows) for name in compared(rows, character)]

    def ends(character: str, name: str, metric: str) -> list[Row | None]:
        return [_error(rows, character, method, metric) for method in (name, PAIRS[name], LINE_METHOD)]

    about = (
        "Each network's mean errors on the test poses, by itself (ring) and beside a ridge regression (arrow's tip). "
    )
    return arrow_chart(groups, ends, ("by itself", "beside a straight line", "the line alone"), about)


def study_chart(
    rows: Sequence[Row], others: Sequence[Row], names: tuple[str, str]
) -> "tuple[matplotlib.figure.Figure, Words] | None":
    """Return (figure, words): an arrow for each main method of each character, from one set of rows to another.

    rows, others: the sets, of characters of the same names.
    names: what the sets are.
    """
    there = [character for character in characters_of(others) if character in characters_of(rows)]
    groups = [(character, name) for character in there for name in STUDIED]

    def ends(character: str, name: str, metric: str) -> list[Row | None]:
        return [_error(each, character, name, metric) for each in (rows, others)]

    about = f"Mean errors on the test poses: {names[0]} (ring) and {names[1]} (arrow's tip). "
    return arrow_chart([each for each in groups if all(ends(*each, MEASURES[0][0]))], ends, names, about)


def layout_chart(rows: Sequence[Row]) -> "tuple[matplotlib.figure.Figure, Words] | None":
    """Return `study_chart` of characters with rows of a second layout of charts, as of teen@one_face; None without."""
    both = second_layouts(rows)
    others = [row for _, each in both.values() for row in each]
    return study_chart(rows, others, ("the face in bands", ", ".join({layout for layout, _ in both.values()})))


def profile_chart(results: str) -> "tuple[matplotlib.figure.Figure, Words] | None":
    """Return `study_chart` of some results and those with the profile `paper`; None without them.

    results: "reference", or the profile of a run of yours.
    """
    return study_chart(open_results(results).rows, paper_profile_rows(results), ("laptop", "paper"))


def clips_chart(results: str) -> "tuple[matplotlib.figure.Figure, Words] | None":
    """Return `study_chart` of some results and those on whole clips; None without them.

    results: as for `profile_chart`.
    """
    names = ("single frames held out", "whole clips held out")
    return study_chart(open_results(results).rows, clips_rows(results), names)


def arrow_chart(
    groups: Sequence[tuple[str, str]],
    ends: Callable[[str, str, str], Sequence[Row | None]],
    names: Sequence[str],
    about: str,
) -> "tuple[matplotlib.figure.Figure, Words] | None":
    """Return (figure, words): for each (character, method) an arrow between two errors, and a cross at a third.

    ends: (character, method, metric) → the errors at the arrow's ring, at its tip, and, if there is one, at the cross.
    names: what these are.
    about: the beginning of the caption.

    None without groups.
    """
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    if not groups:
        return None
    owners = list(dict.fromkeys(character for character, _ in groups))
    places = [k + owners.index(character) for k, (character, _) in enumerate(groups)]  # a line free between characters
    figure = Figure((WIDTH, LINE_HEIGHT * (places[-1] + 1) + LINE_FRAME), dpi=DPI, layout="constrained")
    phrases = []
    for axes, (metric, unit, label) in zip(figure.subplots(1, 2, sharey=True), MEASURES, strict=True):
        for place, (character, name) in zip(places, groups, strict=True):
            start, end, *cross = (row.value if row else None for row in ends(character, name, metric))
            colour = method_named(name).colour
            arrow = {"arrowstyle": "-|>", "color": colour, "linewidth": 2, "shrinkA": 5, "shrinkB": 0}
            axes.annotate("", (end, place), (start, place), arrowprops=arrow)
            axes.plot([start, end], [place, place], linestyle="", marker="")  # arrows set no limits
            axes.plot(start, place, "o", markerfacecolor="white", markeredgecolor=colour, markersize=8)
            axes.plot([value for value in cross if value], [place] * sum(map(bool, cross)), "x", color="black", ms=7)
            values = (round_off(value, unit) for value in (start, end))
            phrases.append(f"{character}, {method_named(name).label}: {' to '.join(values)} {unit}")
        axes.set_yticks(places, [f"{character}: {method_named(name).label}" for character, name in groups])
        axes.set_ylim(places[-1] + 0.6, -0.6)
        axes.set_xlabel(label)
        axes.margins(x=0.08)
        error_scale(axes)
        tidy(axes)
        enlarge(axes)
    signs = (
        {"marker": "o", "linestyle": "", "markerfacecolor": "white", "color": "0.3"},
        {"marker": ">", "linestyle": "-", "color": "0.3"},
        {"marker": "x", "linestyle": "", "color": "black"},
    )
    handles = [Line2D([], [], label=name, **sign) for name, sign in zip(names, signs, strict=False)]
    figure.legend(handles=handles, loc="outside upper center", ncols=3, frameon=False, fontsize=LETTER_PT)
    crosses = f"Crosses: {names[2]}. " if len(names) > 2 else ""
    return figure, Words(
        f"Two charts of arrows, mean errors: {names[0]} and {names[1]}. {'; '.join(phrases)}.",
        f"{about}{crosses}The axes are logarithmic.",
    )


def _error(rows: Sequence[Row], character: str, method: str, metric: str) -> Row | None:
    return find(rows, "table2", character, method, metric)
