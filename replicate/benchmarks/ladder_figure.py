"""The ladder as a figure: each method's errors from an easy rig of a head to a hard one."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from replicate.benchmarks.ladder_tables import APART, RUNGS, TABLE, rungs_of
from replicate.drawing.panels import DPI, Words
from replicate.drawing.style import LETTER_PT, MEASURES, WIDTH, enlarge, error_scale, tidy
from replicate.methods.method_registry import in_order, method_named
from replicate.report.results import Row, find
from replicate.report.tables import round_off

if TYPE_CHECKING:
    import matplotlib.figure

HEIGHT = 8.4  # inches, of both panels
LEFT_OUT = "neutral"  # far above all others
SIZES = {"coarse": 14}  # of marks: refined ones lie on the coarse ones
MARKERS = {"dense": "s", "lbs32": "^", "regional": "D", "linear": "v"}  # others are round
WORDS = {"mm": "mm", "deg": "degrees"}


def ladder_figure(rows: Sequence[Row], head: str) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): both mean errors of each method on the rungs of a head's ladder, a method a colour."""
    from matplotlib.figure import Figure

    rungs = rungs_of(rows, head)
    places = {rung: place + 0.4 * (rung in APART) for place, rung in enumerate(rungs)}
    methods = [name for name in in_order({row.method for row in rows if row.table == TABLE}) if name != LEFT_OUT]
    figure = Figure((WIDTH, HEIGHT), dpi=DPI, layout="constrained")
    phrases = []
    for axes, (metric, unit, label) in zip(figure.subplots(2, 1, sharex=True), MEASURES, strict=True):
        for name in methods:
            found = {rung: find(rows, TABLE, f"{head}@{rung}", name, metric) for rung in rungs}
            values = {rung: row.value for rung, row in found.items() if row}
            climb, alone = ([rung for rung in values if (rung in APART) is apart] for apart in (False, True))
            looks = {
                "color": method_named(name).colour,
                "marker": MARKERS.get(name, "o"),
                "markersize": SIZES.get(name, 8),
                "linewidth": 2.2,
            }
            title = method_named(name).title
            axes.plot([places[rung] for rung in climb], [values[rung] for rung in climb], label=title, **looks)
            axes.plot([places[rung] for rung in alone], [values[rung] for rung in alone], linestyle="", **looks)
            numbers = ", ".join(
                f"{_label(rung)} {round_off(value, unit)}".replace("\n", " ") for rung, value in values.items()
            )
            phrases.append(f"{title}, {WORDS[unit]}: {numbers}")
        axes.set_xticks(list(places.values()), [_label(rung).replace(" ", "\n") for rung in rungs])
        axes.set_ylabel(label)
        error_scale(axes, "y")
        tidy(axes)
        enlarge(axes)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, frameon=False, fontsize=LETTER_PT)
    steps = "; ".join(RUNGS[rung] if rung in APART else f"@{rung} {RUNGS[rung]}" for rung in rungs)
    return figure, Words(
        f"Two line charts of mean errors on rigs of {head}, one above the other, logarithmic. {'; '.join(phrases)}.",
        f"The ladder of {head}: mean errors of each method on rigs of one head, from an easy one to a hard one "
        f"({steps}). Trainings are shorter than the profile's. † sees the true mesh of each test pose.",
    )


def _label(rung: str) -> str:
    return rung.replace("_", " ") if rung in APART else f"@{rung}"
