"""Trainings that differ in one thing, as a picture: how far each change moves both errors."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from replicate.drawing.panels import DPI, Words
from replicate.drawing.style import MEASURES, WIDTH, enlarge, tidy
from replicate.methods.method_registry import method_named
from replicate.report.results import Row

if TYPE_CHECKING:
    import matplotlib.figure

LINE, SIZE_PT, TICK_PT = 0.32, 12, 10.5  # inches of a line; sizes of letters
METRICS = ("validation_vertex_error", "validation_normal_error")  # in the order of MEASURES


def variants_chart(
    rows: Sequence[Row], name: str, character: str, changes: Mapping[str, Sequence[str]], bases: Sequence[str]
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): both errors of one character's trainings, a line each, from the smaller to the larger.

    name: of the benchmark's table. changes: method → what is changed, in the order of the lines. bases: the changes
    that others start from; a change's bar goes from the error of the last base above it to its own.
    """
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullFormatter

    values = {(r.method, r.metric): r.value for r in rows if r.table == name and r.character == character}
    lines = [
        (method, change)
        for method, words in changes.items()
        for change in words
        if (method, f"{METRICS[1]}[{change}]") in values
    ]
    figure = Figure((WIDTH, 1.0 + LINE * len(lines)), dpi=DPI, layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, metric, (_, _, label) in zip(panels, METRICS, MEASURES, strict=True):
        base = None
        for place, (method, change) in enumerate(lines):
            error, colour = values[method, f"{metric}[{change}]"], method_named(method).colour
            if change in bases:
                base = error
            elif base is not None:
                axes.plot([base, error], [place, place], color=colour, linewidth=2, alpha=0.4)
            axes.plot(error, place, "D" if change in bases else "o", color=colour, markersize=6)
            axes.annotate(f"{error:.2g}", (error, place), (6, 0), textcoords="offset points", va="center")
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.margins(x=0.18)
        axes.set_xlabel(label)
        tidy(axes)
        enlarge(axes, SIZE_PT)
        axes.tick_params(axis="x", labelsize=TICK_PT)
    several = len({method for method, _ in lines}) > 1
    names = [f"{method_named(method).label}: {change}" if several else change for method, change in lines]
    panels[0].set_yticks(range(len(lines)), names)
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
