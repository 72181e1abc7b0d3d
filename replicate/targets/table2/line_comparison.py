"""The paper's networks with and without a straight line beside them: what part of a ranking is how they are trained?

A network that starts from nothing must first learn what ridge regression knows. With the regression beside it, it
learns the rest alone, and what then still differs between networks is their architecture's.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from replicate.drawing.panels import DPI, Words
from replicate.drawing.style import LETTER_PT, MEASURES, WIDTH, enlarge, error_scale, tidy
from replicate.methods.method_registry import method_named
from replicate.report.cast import characters_of
from replicate.report.results import Row, find
from replicate.report.tables import Table, round_off

if TYPE_CHECKING:
    import matplotlib.figure

PAIRS = {"coarse": "coarse_line", "refined": "refined_line", "dense": "dense_line", "pca": "pca_line"}
LINE = "linear"
RATIOS = (("refined", "coarse"), ("refined", "dense"))  # what claims C1, and C2 and C5, compare
LINE_HEIGHT, FRAME = 0.36, 1.7  # inches: a network, and what is above and below them
NOTE = "Linear: the line alone, ridge regression from rig parameters to vertices."


def compared(rows: Sequence[Row], character: str) -> list[str]:
    """Return which networks a character has with a line beside them and without."""
    metric = MEASURES[0][0]
    return [name for name, line in PAIRS.items() if all(_error(rows, character, m, metric) for m in (name, line))]


def line_table(rows: Sequence[Row], character: str) -> Table | None:
    """Return both mean errors and the size of each network without and with a line; None where no network has one."""
    networks = compared(rows, character)
    if not networks:
        return None
    metrics = (*(metric for metric, *_ in MEASURES), "model_size")
    body: list[tuple[str, ...] | None] = []
    for name in networks:
        numbers = [_error(rows, character, method, metric) for metric in metrics for method in (name, PAIRS[name])]
        body.append((method_named(name).label, *(round_off(row.value, row.unit) if row else "–" for row in numbers)))
    numbers = [_error(rows, character, LINE, metric) for metric in metrics]
    alone = [round_off(row.value, row.unit) if row else "–" for row in numbers]
    body.append((method_named(LINE).label, *(cell for value in alone for cell in (value, ""))))
    ratios = [line for above, below in RATIOS if (line := _ratio_line(rows, character, above, below, networks))]
    body += [None, *ratios] if ratios else []
    header = ("", *(f"{what}{how}" for what in ("mm", "degrees", "MB") for how in ("", ", with a line")))
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
    """Return (figure, words): an arrow for each network of each character, from its error without a line to that with.

    A cross is the line alone. None where no network has a line beside it.
    """
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    groups = [(character, name) for character in characters_of(rows) for name in compared(rows, character)]
    if not groups:
        return None
    owners = list(dict.fromkeys(character for character, _ in groups))
    places = [k + owners.index(character) for k, (character, _) in enumerate(groups)]  # a line free between characters
    figure = Figure((WIDTH, LINE_HEIGHT * (places[-1] + 1) + FRAME), dpi=DPI, layout="constrained")
    phrases = []
    for axes, (metric, unit, label) in zip(figure.subplots(1, 2, sharey=True), MEASURES, strict=True):
        for place, (character, name) in zip(places, groups, strict=True):
            without, with_line = (_error(rows, character, method, metric).value for method in (name, PAIRS[name]))
            colour = method_named(name).colour
            arrow = {"arrowstyle": "-|>", "color": colour, "linewidth": 2, "shrinkA": 5, "shrinkB": 0}
            axes.annotate("", (with_line, place), (without, place), arrowprops=arrow)
            axes.plot([without, with_line], [place, place], linestyle="", marker="")  # arrows set no limits
            axes.plot(without, place, "o", markerfacecolor="white", markeredgecolor=colour, markersize=8)
            if alone := _error(rows, character, LINE, metric):
                axes.plot(alone.value, place, "x", color="black", markersize=7)
            ends = (round_off(value, unit) for value in (without, with_line))
            phrases.append(f"{character}, {method_named(name).label}: {' to '.join(ends)} {unit}")
        names = [f"{character}: {method_named(name).label}" for character, name in groups]
        axes.set_yticks(places, names)
        axes.set_ylim(places[-1] + 0.6, -0.6)
        axes.set_xlabel(label)
        axes.margins(x=0.08)
        error_scale(axes)
        tidy(axes)
        enlarge(axes)
    ring = Line2D([], [], marker="o", linestyle="", markerfacecolor="white", color="0.3", label="by itself")
    tip = Line2D([], [], marker=">", linestyle="-", color="0.3", label="beside a straight line")
    cross = Line2D([], [], marker="x", linestyle="", color="black", label="the line alone")
    figure.legend(handles=[ring, tip, cross], loc="outside upper center", ncols=3, frameon=False, fontsize=LETTER_PT)
    return figure, Words(
        f"Two charts of arrows, mean errors without and with a straight line beside a network. {'; '.join(phrases)}.",
        "Each network's mean errors on the test poses, by itself (ring) and beside a ridge regression (arrow's tip). "
        "Crosses are the regression alone. The axes are logarithmic.",
    )


def _error(rows: Sequence[Row], character: str, method: str, metric: str) -> Row | None:
    return find(rows, "table2", character, method, metric)
