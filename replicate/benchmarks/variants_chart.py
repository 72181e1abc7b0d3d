"""Trainings that differ in one thing, as a picture: how far each change moves both errors."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from replicate.drawing.panels import DPI, Words
from replicate.drawing.style import MEASURES, WIDTH, enlarge, tidy
from replicate.methods.method_registry import method_named
from replicate.report.results import Row
from replicate.report.tables import round_off

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.figure

LINE, SIZE_PT = 0.34, 13  # inches of a line; the size of letters
SHORT = 0.6  # decades: on a longer axis ticks at equal steps would touch
BESIDE = 48  # points from the right of a panel to the end of a number
METRICS = ("validation_vertex_error", "validation_normal_error")  # in the order of MEASURES


def variants_chart(
    rows: Sequence[Row], name: str, character: str, changes: Mapping[str, Sequence[str]], bases: Sequence[str]
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): both errors of one character's trainings, a line each, from the smaller to the larger.

    name: of the benchmark's table. changes: method → what is changed, in the order of the lines. bases: the changes
    that others start from; a change's bar goes from the error of the last base above it to its own. Errors as numbers
    stand in a column at the right of each panel, where no bar crosses them.
    """
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

    values = {(r.method, r.metric): r.value for r in rows if r.table == name and r.character == character}
    lines = [
        (method, change)
        for method, words in changes.items()
        for change in words
        if (method, f"{METRICS[1]}[{change}]") in values
    ]
    figure = Figure((WIDTH, 1.0 + LINE * len(lines)), dpi=DPI, layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, metric, (_, unit, label) in zip(panels, METRICS, MEASURES, strict=True):
        base = None
        for place, (method, change) in enumerate(lines):
            error, colour = values[method, f"{metric}[{change}]"], method_named(method).colour
            if change in bases:
                base = error
            elif base is not None:
                axes.plot([base, error], [place, place], color=colour, linewidth=2, alpha=0.4)
            axes.plot(error, place, "D" if change in bases else "o", color=colour, markersize=6)
            beside = {"textcoords": "offset points", "ha": "right", "va": "center", "annotation_clip": False}
            axes.annotate(round_off(error, unit), (1, place), (BESIDE, 0), ("axes fraction", "data"), **beside)
        axes.set_xscale("log")
        axes.margins(x=0.06)
        short = np.ptp(np.log10(axes.get_xlim())) < SHORT
        axes.xaxis.set_major_locator(MaxNLocator(4, steps=(1, 2, 5, 10)) if short else LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter(partial(_tick, axes))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xlabel(label)
        tidy(axes)
        enlarge(axes, SIZE_PT)
    panels[0].set_yticks(range(len(lines)), _names(lines, bases))
    panels[0].set_ylim(len(lines) - 0.5, -0.5)
    worst = max(lines, key=lambda line: values[line[0], f"{METRICS[1]}[{line[1]}]"])
    best = min(lines, key=lambda line: values[line[0], f"{METRICS[1]}[{line[1]}]"])
    ends = " ".join(
        f"The {word} normal error, {values[method, f'{METRICS[1]}[{change}]']:.2g} degrees, is of {method}, {change}."
        for word, (method, change) in (("smallest", best), ("largest", worst))
    )
    return figure, Words(
        f"Two dot charts of validation errors of {len(lines)} trainings of {character}. {ends}",
        f"Errors of {character}'s networks on the validation poses, a training a line. Diamonds are recipes as they "
        "are; a circle is the recipe above it with the one change that stands at its left.",
    )


def _names(lines: Sequence[tuple[str, str]], bases: Sequence[str]) -> list[str]:
    """Return what stands at the left of each line: a base by its name, what is changed of it without that name."""
    several, names, base = len({method for method, _ in lines}) > 1, [], ""
    for method, change in lines:
        if change in bases:
            base = change
            names.append(f"{method_named(method).label}: {change}" if several else change)
        else:
            names.append(change.removeprefix(f"{base}, "))
    return names


def _tick(axes: "matplotlib.axes.Axes", value: float, place: int | None = None) -> str:
    """Return a tick's number; those of an axis that is shorter than a decade have equally many decimals."""
    low, high = sorted(axes.get_xlim())
    shown = [f"{tick:.6g}" for tick in axes.xaxis.get_majorticklocs() if low <= tick <= high]
    decimals = max((len(text.partition(".")[2]) for text in shown), default=0)
    return f"{value:.{decimals}f}" if high < 10 * low else f"{value:g}"
