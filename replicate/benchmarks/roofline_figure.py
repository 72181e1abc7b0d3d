"""The roofline as a figure: multiplications a second against multiplications a byte, every backend a dot."""

from collections.abc import Sequence
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from replicate.drawing.panels import DPI, Words
from replicate.drawing.style import WIDTH, enlarge, tidy
from replicate.methods.method_registry import method_named
from replicate.report.results import Row, find
from replicate.timing.timed_names import BACKENDS, FAST, HALF, JAX, ONNX, PLAIN, in_table_order, parted

if TYPE_CHECKING:
    import matplotlib.figure
    import matplotlib.text

TABLE, MACHINE = "bench_roofline", "machine"
PEAK, CACHE, MEMORY = "multiply_adds_per_s", "bytes_per_s[cache]", "bytes_per_s[memory]"
HEIGHT = 6.4  # inches
BILLION = 1e9
MARKERS = {PLAIN: "v", "": "^", JAX: "P", ONNX: "s", FAST: "o", HALF: "D"}
KEYS = {PLAIN: "plain torch", "": "the suite's torch"}
ROOFS = (  # metric, label, line, and the label's place: at this share of the peak, on this side, so many points off
    (CACHE, "caches", "-", 0.11, "bottom", (-2, 4)),
    (MEMORY, "memory", ":", 0.14, "top", (2, -4)),
)
BACKGROUND = {"facecolor": "white", "edgecolor": "none", "pad": 1}  # of letters that lines would cross


def roofline_figure(rows: Sequence[Row], character: str) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): what each way to evaluate the networks of a character reaches of the core's peaks."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    own = [row for row in rows if row.character == character]

    def value(name: str, metric: str) -> float:
        return find(own, TABLE, character, name, metric).value

    names = in_table_order({row.method for row in own} - {MACHINE})
    dots = {name: _dot(value, name) for name in names}
    peak = value(MACHINE, PEAK) / BILLION
    low, high = min(x for x, _ in dots.values()) / 2, max(x for x, _ in dots.values()) * 3
    bottom = min(y for _, y in dots.values()) / 2
    figure = Figure((WIDTH, HEIGHT), dpi=DPI, layout="constrained")
    axes = figure.subplots()
    across = np.geomspace(low, high, 200)
    for metric, _, style, *_ in ROOFS:
        slope = value(MACHINE, metric) / BILLION
        axes.plot(across, np.minimum(peak, slope * across), style, color="0.35", linewidth=1.5, zorder=1)
    place = {"textcoords": "offset points", "ha": "right", "color": "0.35"}
    axes.annotate(f"peak: {peak:.0f} billion a second", (high, peak), (-4, 6), **place)
    for name, (x, y) in dots.items():
        method, ending = parted(name)
        style = {"color": method_named(method).colour, "markersize": 11, "markeredgecolor": "white"}
        style["zorder"] = 4 if ending in (FAST, HALF) else 3
        axes.plot(x, y, MARKERS[ending], **style)
    labels_of_methods = []
    for method in dict.fromkeys(parted(name)[0] for name in names):
        colour = method_named(method).colour
        own_dots = [dots[method + ending] for ending in MARKERS if method + ending in dots]
        axes.plot(*zip(*own_dots, strict=True), color=colour, linewidth=1, alpha=0.35, zorder=2)
        x, y = dots.get(method + FAST, own_dots[-1])
        right = x < np.sqrt(low * high)
        place = {"textcoords": "offset points", "ha": "left" if right else "right", "va": "center", "color": colour}
        place |= {"bbox": BACKGROUND, "zorder": 2.5}
        label = axes.annotate(method_named(method).label, (x, y), (11 if right else -11, 0), **place)
        labels_of_methods.append(label)
    axes.set(xscale="log", yscale="log", xlim=(low, high), ylim=(bottom, peak * 2))
    axes.set_xlabel("multiplications a byte of weights")
    axes.set_ylabel("billion multiplications a second")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:g}")
    present = [ending for ending in MARKERS if any(parted(name)[1] == ending for name in names)]
    keys = [Line2D([], [], marker=MARKERS[e], color="0.35", linestyle="", markersize=10) for e in present]
    axes.legend(keys, [KEYS.get(ending, BACKENDS[ending]) for ending in present], loc="lower right", frameon=False)
    figure.draw_without_rendering()  # the layout decides how steep a slope is
    for metric, label, _, share, side, offset in ROOFS:
        slope = value(MACHINE, metric) / BILLION
        at = max(1.1 * low, peak / slope * share)
        (x0, y0), (x1, y1) = axes.transData.transform([(at, slope * at), (2 * at, slope * 2 * at)])
        place = {"rotation": np.degrees(np.arctan2(y1 - y0, x1 - x0)), "rotation_mode": "anchor", "va": side}
        words = f"{label}, {slope:.0f} GB/s"
        axes.annotate(words, (at, slope * at), offset, textcoords="offset points", color="0.35", **place)
    tidy(axes)
    enlarge(axes)
    figure.draw_without_rendering()
    _lift(labels_of_methods)
    labels = {name: f"{method_named(parted(name)[0]).label}, {BACKENDS[parted(name)[1]]}" for name in names}
    phrases = [f"{labels[name]}: {y:.2g} billion a second at {x:.2g} a byte" for name, (x, y) in dots.items()]
    return figure, Words(
        f"A roofline chart for {character}, with a peak of {peak:.0f} billion a second: {'; '.join(phrases)}.",
        f"Roofline of one core: {character}. A dot is one way to evaluate one method's networks. No dot can lie above "
        "the flat line, the core's arithmetic; below the slopes weights come from caches or from memory fast enough.",
    )


def _lift(labels: "Sequence[matplotlib.text.Annotation]") -> None:
    """Move labels upwards that others lie on, the lowest first. They have been drawn, so that their sizes are known."""
    for lower, upper in combinations(sorted(labels, key=lambda label: label.xy[1]), 2):
        below, above = lower.get_window_extent(), upper.get_window_extent()
        if below.overlaps(above):
            across, up = upper.xyann
            upper.xyann = across, up + (below.y1 - above.y0) * 72 / upper.figure.dpi + 1


def _dot(value: object, name: str) -> tuple[float, float]:
    """Return multiplications a byte, and billions of them a second."""
    count = value(name, "multiplications")
    return count / (1e6 * value(name, "read")), count / value(name, "network") / 1e6
