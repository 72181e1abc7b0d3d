"""How the cost of a pose grows, as a figure of four panels: milliseconds against what is varied, a method a colour."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from replicate.drawing.panels import DPI, Words
from replicate.drawing.style import WIDTH, enlarge, error_scale, tidy
from replicate.methods.method_registry import method_named
from replicate.report.results import Row
from replicate.report.tables import round_off
from replicate.timing.timed_names import BACKENDS, FAST, PLAIN, in_table_order, parted

if TYPE_CHECKING:
    import matplotlib.figure

HEIGHT = 8.4  # inches
LABELS = {
    "vertices": "vertices",
    "segments": "segments",
    "map_size": "pixels a side of a map",
    "components": "components a region",
}
USUAL = {"vertices": 11_200, "segments": 8, "map_size": 32, "components": 96}
STYLES = {PLAIN: (":", "v"), "": ("--", "^"), FAST: ("-", "o")}
KEYS = {PLAIN: "plain torch", "": "the suite's torch", FAST: "fast"}


def growth_figure(rows: Sequence[Row]) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): `bench_growth`'s times, a panel for each size that is varied."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    figure = Figure((WIDTH, HEIGHT), dpi=DPI, layout="constrained")
    panels = figure.subplots(2, 2, sharey=True)
    phrases = []
    for axes, (varied, label) in zip(panels.flat, LABELS.items(), strict=True):
        lines = _lines(rows, varied)
        for name, points in lines.items():
            method, ending = parted(name)
            style, marker = STYLES[ending]
            colour = method_named(method).colour
            axes.plot(*zip(*points, strict=True), style, marker=marker, color=colour, linewidth=2.2, markersize=8)
            (low, least), (high, most) = points[0], points[-1]
            words = f"{method_named(method).label}, {BACKENDS[ending]}"
            phrases.append(
                f"{words}, {low:,} to {high:,} {label}: {round_off(least, 'ms')} to {round_off(most, 'ms')} ms"
            )
        axes.axvline(USUAL[varied], color="0.55", linewidth=1.2, linestyle=(0, (1, 3)), zorder=1)
        values = [value for value, _ in next(iter(lines.values()))]
        axes.set_xscale("log", base=2)
        unit = 1_000 if values[0] >= 1_000 else 1
        axes.set_xticks(values, [f"{value / unit:g}" for value in values])
        axes.set_xlabel(f"thousand {label}" if unit > 1 else label)
    error_scale(panels[0, 0], "y")
    for axes in panels.flat:
        tidy(axes)
        enlarge(axes)
    for axes in panels[:, 0]:
        axes.set_ylabel("milliseconds a pose")
        enlarge(axes)
    names = in_table_order({row.method for row in rows})
    methods = list(dict.fromkeys(parted(name)[0] for name in names))
    endings = [ending for ending in STYLES if any(parted(name)[1] == ending for name in names)]
    keys = [Line2D([], [], color=method_named(method).colour, linewidth=4) for method in methods]
    keys += [Line2D([], [], color="0.35", linestyle=STYLES[e][0], marker=STYLES[e][1], markersize=8) for e in endings]
    labels = [method_named(method).label for method in methods] + [KEYS[ending] for ending in endings]
    figure.legend(keys, labels, loc="outside upper center", ncols=4, frameon=False, fontsize=15.5)
    return figure, Words(
        f"Four line charts of milliseconds a pose on one core. {'; '.join(phrases)}.",
        "How the cost of a pose grows: networks of random weights on one core; both axes are logarithmic. In each "
        "panel one size is varied; the dotted line is about where teen is.",
    )


def _lines(rows: Sequence[Row], varied: str) -> dict[str, list[tuple[int, float]]]:
    """Return by name the points (size, milliseconds) of one panel, from the least size on."""
    start = f"network[{varied}="
    own = [row for row in rows if row.metric.startswith(start)]
    return {
        name: sorted((int(row.metric.removeprefix(start).rstrip("]")), row.value) for row in own if row.method == name)
        for name in in_table_order({row.method for row in own})
    }
