"""Table 2 as a chart: our means and the paper's, method by method, so that orderings can be seen."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from replicate.drawing.panels import DPI, Words
from replicate.drawing.style import LETTER_PT, MEASURES, WIDTH, enlarge, error_scale, tidy
from replicate.methods.method_registry import in_order, method_named
from replicate.report.cast import STANDS_FOR
from replicate.report.results import Row, find
from replicate.report.tables import round_off

if TYPE_CHECKING:
    import matplotlib.figure

UNITS = {"mm": "mm", "deg": "degrees"}
OURS, THEIRS = "#333333", "black"
LINE, FRAME = 0.37, 1.35  # inches: a method, and what is above and below them
BESIDE = 9  # points from a mark to its number
AT_THE_END = 3  # times: a dot within them of the largest one has its number on the left, unless a ring is there


def table2_chart(ours: Sequence[Row], paper: Sequence[Row], character: str) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): one character's mean errors (dots) and those of the paper's counterpart (rings).

    The axes are logarithmic: ratios can be compared, and a large error takes no room from the small ones. The neutral
    row is given in words.
    """
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    theirs = STANDS_FOR.get(character, "")
    names = {row.method for row in ours if row.character == character and row.metric == MEASURES[0][0]}
    methods = [method for method in map(method_named, in_order(names)) if method.in_charts]
    figure = Figure((WIDTH, LINE * len(methods) + FRAME), dpi=DPI, layout="constrained")
    phrases, motion = [], []
    for axes, (metric, unit, label) in zip(figure.subplots(1, 2, sharey=True), MEASURES, strict=True):
        shown = [find(ours, "table2", character, method.name, metric).value for method in methods]
        largest = max(shown, default=0.0)
        for y, method in enumerate(methods):
            mine, other = (
                find(rows, "table2", who, method.name, metric) for rows, who in ((ours, character), (paper, theirs))
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
        axes.set_yticks(range(len(methods)), [method.title for method in methods])
        axes.set_ylim(len(methods) - 0.4, -0.6)
        axes.margins(x=0.34)  # room for numbers on both sides
        axes.set_xlabel(label.replace("normal angle error", "normal error"))
        error_scale(axes)
        tidy(axes)
        enlarge(axes)
    dot = Line2D(
        [], [], marker="o", linestyle="", color=OURS, markersize=8, label=f"{character} (ours)" if theirs else character
    )
    ring = Line2D([], [], marker="o", linestyle="", color=THEIRS, markersize=13, label=f"{theirs} (the paper’s)")
    ring.set_markerfacecolor("none")
    handles = [dot, ring] if theirs else [dot]
    figure.legend(handles=handles, frameon=False, fontsize=LETTER_PT, ncols=2, loc="outside upper right")
    return figure, Words(
        f"Two dot charts of mean error by method for {character}: {'; '.join(phrases)}.",
        f"Table 2 as a chart: {character} (dots)"
        + (
            f" beside the paper's {theirs} (rings), another rig: compare orderings and ratios, not millimetres"
            if theirs
            else ""
        )
        + ". The axes are logarithmic. † ‡ see the true mesh of each test pose."
        + (f" The test poses differ from the neutral one by {' and '.join(motion)} on average." if motion else ""),
    )


def _write_beside(axes, text: str, value: float, y: int, side: int) -> None:
    """Write a dot's number beside it, left (-1) or right (1): where the paper's ring isn't, or where there is room."""
    align = "left" if side > 0 else "right"
    axes.annotate(text, (value, y), (side * BESIDE, 0), textcoords="offset points", ha=align, va="center")
