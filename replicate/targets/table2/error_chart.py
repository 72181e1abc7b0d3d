"""Table 2 as a chart: our means and the paper's, method by method, so that orderings can be seen."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from replicate.drawing.panels import DPI, Words
from replicate.drawing.style import MEASURES, tidy
from replicate.methods.method_registry import in_order, method_named
from replicate.report.cast import STANDS_FOR
from replicate.report.results import Row, find
from replicate.report.tables import round_off

if TYPE_CHECKING:
    import matplotlib.figure

UNITS = {"mm": "mm", "deg": "degrees"}


def table2_chart(ours: Sequence[Row], paper: Sequence[Row], character: str) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): one character's mean errors (dots) and those of the paper's counterpart (rings).

    The neutral row, many times the others, is given in words.
    """
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    theirs = STANDS_FOR.get(character, "")
    names = {row.method for row in ours if row.character == character and row.metric == MEASURES[0][0]}
    methods = [method for method in map(method_named, in_order(names)) if method.in_charts]
    figure = Figure((10, 0.36 * len(methods) + 1.2), dpi=DPI, layout="constrained")
    phrases, motion = [], []
    for axes, (metric, unit, label) in zip(figure.subplots(1, 2, sharey=True), MEASURES, strict=True):
        for y, method in enumerate(methods):
            mine, other = (
                find(rows, "table2", who, method.name, metric) for rows, who in ((ours, character), (paper, theirs))
            )
            axes.plot(mine.value, y, "o", color=method.colour, markersize=8)
            text = round_off(mine.value, unit)
            axes.annotate(text, (mine.value, y), (0, 7), textcoords="offset points", ha="center", fontsize=7)
            if mine.sd is not None:
                axes.errorbar(mine.value, y, xerr=mine.sd, color=method.colour, capsize=3)
            if other:
                axes.plot(other.value, y, "o", markerfacecolor="none", markeredgecolor="black", markersize=8)
            phrases.append(f"{method.label} {text} {UNITS[unit]}")
        if still := find(ours, "table2", character, "neutral", metric):
            motion.append(f"{round_off(still.value, unit)} {UNITS[unit]}")
        axes.set_yticks(range(len(methods)), [method.title for method in methods])
        axes.set_xlim(left=0)
        axes.set_xlabel(label)
        tidy(axes)
    axes.invert_yaxis()
    dot = Line2D([], [], marker="o", linestyle="", color="#333333", label=character)
    ring = Line2D([], [], marker="o", linestyle="", color="black", markerfacecolor="none", label=f"{theirs} (paper)")
    axes.legend(handles=[dot, ring] if theirs else [dot], frameon=False, fontsize=8, loc="lower right")
    return figure, Words(
        f"Two dot charts of mean error by method for {character}: {'; '.join(phrases)}.",
        f"Table 2 as a chart: {character} (dots)"
        + (
            f" beside the paper's {theirs} (rings), another rig: compare orderings and ratios, not millimetres"
            if theirs
            else ""
        )
        + ". † ‡ see the true mesh of each test pose."
        + (f" The test poses differ from the neutral one by {' and '.join(motion)} on average." if motion else ""),
    )
