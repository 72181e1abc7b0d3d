"""Error against milliseconds and megabytes: what a smaller error costs, every method a dot."""

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from replicate.drawing.panels import DPI, Words
from replicate.drawing.style import WIDTH, enlarge, error_scale, tidy
from replicate.methods.method_registry import in_order, method_named
from replicate.report.results import Row, find
from replicate.report.tables import round_off
from replicate.targets.table3.best_times import best_row
from replicate.targets.table3.timing_rows import ALL
from replicate.timing.timed_names import NODES, RIG, parted

if TYPE_CHECKING:
    import matplotlib.figure

ERROR = "normal_error_mean"
AXES = ((f"time_{ALL}", "ms", "milliseconds a pose, all cores"), ("model_size", "MB", "size, MB"))
HEIGHT = 5.2  # inches
BACKGROUND = {"facecolor": "white", "edgecolor": "none", "pad": 1}  # of letters that lines would cross
LINES = {
    NODES: ("rig, node by node", "left", 4),
    RIG: ("rig, compiled", "right", -3),
}  # words, beside which their line is
ABOVE, BELOW = 10, -25  # a dot, in points
INSIDE = 6  # pixels between a label and the end of its panel
NEAR = (0.45, 0.05)  # of two dots, in shares of all dots' costs and in powers of ten of errors: their labels would meet


def frontier_chart(
    times: Sequence[Row], errors: Sequence[Row], character: str
) -> "tuple[matplotlib.figure.Figure, Words] | None":
    """Return (figure, words): a character's normal errors against time and against size, on logarithmic axes.

    times: rows of Table 3. errors: rows of Table 2. None where no method has both.
    """
    from matplotlib.figure import Figure

    names = in_order(
        parted(row.method)[0]
        for row in times
        if row.character == character
        and row.metric == AXES[0][0]
        and find(errors, "table2", character, parted(row.method)[0], ERROR)
    )
    names = [name for name in names if find(times, "table3", character, name, "model_size")]
    if not names:
        return None
    figure = Figure((WIDTH, HEIGHT), dpi=DPI, layout="constrained")
    phrases = []
    for axes, (metric, unit, label) in zip(figure.subplots(1, 2, sharey=True), AXES, strict=True):
        dots = {
            name: (_cost(times, character, name, metric), find(errors, "table2", character, name, ERROR).value)
            for name in names
        }
        for name, (cost, error) in dots.items():
            method = method_named(name)
            axes.plot(cost, error, "o", color=method.colour, markersize=10, zorder=3)
            place = {"textcoords": "offset points", "ha": "center", "zorder": 2, "bbox": BACKGROUND}
            axes.annotate(method.label, (cost, error), (0, BELOW if _is_crowded(name, dots) else ABOVE), **place)
            phrases.append(f"{method.label}: {round_off(cost, unit)} {unit}, {round_off(error, 'deg')}°")
        for name, (words, side, aside) in LINES.items() if unit == "ms" else ():
            if row := find(times, "table3", character, name, metric):
                axes.axvline(row.value, color="0.45", linestyle=":", zorder=1)
                style = {"rotation": 90, "ha": side, "va": "bottom", "color": "0.35"}
                axes.annotate(words, (row.value, 0), (aside, 4), ("data", "axes fraction"), "offset points", **style)
        axes.margins(x=0.22, y=0.16)
        axes.set_xlabel(label)
        error_scale(axes)
        error_scale(axes, "y")
        tidy(axes)
        enlarge(axes)
    figure.axes[0].set_ylabel("normal error, degrees")
    enlarge(figure.axes[0])
    _keep_inside(figure, {method_named(name).label for name in names})
    return figure, Words(
        f"Two dot charts for {character}, normal error against time and against size: {'; '.join(phrases)}.",
        f"Error against time and size: {character}. The axes are logarithmic; lower and further left is better. "
        "Dotted: the rig, whose error is zero.",
    )


def _keep_inside(figure: "matplotlib.figure.Figure", labels: Collection[str]) -> None:
    """Move dots' labels that would cross the left or the right end of their panel so far that they don't."""
    figure.draw_without_rendering()  # the layout decides how long a panel is
    for axes in figure.axes:
        room = axes.get_window_extent()
        for text in axes.texts:
            if text.get_text() in labels:
                own = text.get_window_extent()
                pixels = max(room.x0 + INSIDE - own.x0, 0) or min(room.x1 - INSIDE - own.x1, 0)
                across, up = text.xyann
                text.xyann = (across + pixels * 72 / figure.dpi, up)


def _is_crowded(name: str, dots: Mapping[str, tuple[float, float]]) -> bool:
    """Return whether another dot is so near that labels would meet; of both the one of the smaller cost says so."""
    places = {each: np.log10(dot) for each, dot in dots.items()}
    span = np.ptp([cost for cost, _ in places.values()])
    for other, place in places.items():
        cost, error = place - places[name]
        if (cost, other) > (0, name) and cost <= NEAR[0] * span and abs(error) < NEAR[1]:
            return True
    return False


def _cost(times: Sequence[Row], character: str, name: str, metric: str) -> float:
    row = find(times, "table3", character, name, metric)
    return (best_row(times, character, name, ALL) if metric == AXES[0][0] else row).value
