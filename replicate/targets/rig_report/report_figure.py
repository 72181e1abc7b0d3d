"""The rig report of one character as a figure: six panels that answer how hard its rig is."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from replicate.drawing.heatmap import colour_bar, error_colours
from replicate.drawing.panels import DPI, Words
from replicate.drawing.render import render
from replicate.drawing.scene import Surface, camera_for
from replicate.drawing.style import LETTER_PT, WIDTH, tidy
from replicate.geometry.mesh import Mesh
from replicate.report.results import Row, find
from replicate.report.tables import round_off
from replicate.targets.rig_report.method_names import LABELS, features_text
from replicate.targets.rig_report.report_tables import map_sizes

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.figure

LINE, ACCENT, SECOND = "#555555", "#0072B2", "#D55E00"
BARS = {"neutral": "#BBBBBB", "linear": "#56B4E9", "squares": "#0072B2", "products": "#003F66", "basis": "#009E73"}
RATIO_LIMIT = 0.15  # upper end of the heatmap's colours, the same for every character
FACE = (396, 446)  # pixels
SIZE = (WIDTH, 14.5)  # inches
ROWS = (1.0, 1.0, 1.35)  # the heights of rows, in proportion
SIZE_PT = LETTER_PT
PAIRS = 6  # that are shown; the CSV file has more
SMALLEST_DEG = 0.01  # lower end of the maps' errors: what lies below can't be seen


@dataclass(frozen=True)
class Measurements:
    """What the figure shows of a character.

    rows: its rows of rig_report.csv. pairs: its strongest pairs, lines of `control_pairs.PAIR_COLUMNS`. spectrum: (c,),
    each component's share of the variance. curve: (components, mean normal error in degrees) pairs. controls: (n,), how
    many move each vertex. ratio: (n,), mixed over single differences; NaN where no pair of the draw moves a vertex.
    """

    character: str
    rows: Sequence[Row]
    pairs: Sequence[tuple]
    spectrum: np.ndarray
    curve: Sequence
    controls: np.ndarray
    ratio: np.ndarray

    def value(self, method: str, metric: str) -> float | None:
        """Return a number, or None."""
        row = find(self.rows, "rig_report", self.character, method, metric)
        return row.value if row else None


def report_figure(
    mesh: Mesh, numbers: Measurements, renderer: str | None = None
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): errors of fits, components, controls a vertex, map sizes, and interaction twice.

    Without pairs that were tried, the last two are left out.
    """
    from matplotlib.figure import Figure

    tried = numbers.value("pairs", "pairs") is not None  # not of a rig that is known by its samples alone
    heights = ROWS if tried else ROWS[:2]
    figure = Figure((SIZE[0], SIZE[1] * sum(heights) / sum(ROWS)), dpi=DPI, layout="constrained")
    rows = figure.subfigures(len(heights), 1, height_ratios=heights)  # each finds room for its own names
    (errors, components), (controls, maps), *more = (row.subplots(1, 2) for row in rows)
    _draw_errors(errors, numbers)
    _draw_components(components, numbers)
    _draw_controls(controls, numbers)
    _draw_maps(maps, numbers)
    for face, pairs in more:
        _draw_face(figure, face, mesh, numbers, renderer)
        _draw_pairs(pairs, numbers)
    for axes in (*figure.axes, *(child for each in figure.axes for child in each.child_axes)):
        axes.tick_params(which="both", labelsize=SIZE_PT)
        for label in (axes.xaxis.label, axes.yaxis.label):
            label.set_fontsize(SIZE_PT)
    figure.suptitle(f"How hard is a rig? {numbers.character}: {len(mesh.neutral):,} vertices, "
                    f"{numbers.value('influence', 'controls'):,.0f} controls", fontsize=SIZE_PT)  # fmt: skip
    return figure, _words(numbers)


def _draw_errors(axes: "matplotlib.axes.Axes", numbers: Measurements) -> None:
    names = [name for name in BARS if numbers.value(name, "normal_error_mean") is not None]
    degrees = [numbers.value(name, "normal_error_mean") for name in names]
    axes.barh(range(len(names)), degrees, color=[BARS[name] for name in names])
    for y, name in enumerate(names):
        millimetres = round_off(numbers.value(name, "vertex_error_mean"), "mm")
        axes.annotate(f"{degrees[y]:.2f}°, {millimetres} mm", (degrees[y], y), (4, 0), textcoords="offset points",
                      va="center", fontsize=SIZE_PT)  # fmt: skip
    axes.set_yticks(range(len(names)), [LABELS[name] for name in names], fontsize=SIZE_PT)
    axes.set_xlim(0, 2.6 * max(degrees, default=1.0))
    axes.invert_yaxis()
    axes.set_xlabel("mean normal error, degrees")
    axes.set_title("What simple fits miss", fontsize=SIZE_PT)
    tidy(axes)


def _draw_components(axes: "matplotlib.axes.Axes", numbers: Measurements) -> None:
    from matplotlib.ticker import LogLocator

    left = np.maximum(1 - np.cumsum(numbers.spectrum), 1e-9)
    axes.plot(np.arange(1, len(left) + 1), left, color=LINE)
    axes.set(xscale="log", yscale="log", xlabel="principal components", xlim=(0.9, 20 * len(left)))
    axes.set_ylabel("variance left", color=LINE)
    for share in ("99", "99.9", "99.99"):
        count = numbers.value("basis", f"components[{share} % of variance]")
        if count is not None:
            axes.plot(count, left[int(count) - 1], "o", color=LINE)
            axes.annotate(f"{share} %: {count:.0f}", (count, left[int(count) - 1]), (-5, -4),
                          textcoords="offset points", ha="right", va="top", fontsize=SIZE_PT, color=LINE)  # fmt: skip
    tidy(axes)
    degrees = axes.twinx()
    degrees.plot(*np.transpose(numbers.curve), "-", color=SECOND)
    degrees.set_yscale("log")
    degrees.set_ylabel("mean normal error, degrees", color=SECOND)
    for limit in ("0.5", "0.25"):
        count = numbers.value("basis", f"components[{limit} degrees]")
        text, place, shift, fill = f"{limit}°: {count or 0:.0f}", (count, float(limit)), (6, 4), "full"
        if count is None:
            text, place, shift, fill = f"{limit}°: > {len(left)}", numbers.curve[-1], (-64, -2), "none"
        degrees.plot(*place, "o", color=SECOND, fillstyle=fill)
        degrees.annotate(text, place, shift, textcoords="offset points", fontsize=SIZE_PT, color=SECOND)
    degrees.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    degrees.yaxis.set_major_formatter("{x:g}")
    degrees.yaxis.set_minor_formatter("")
    degrees.spines[["top"]].set_visible(False)
    axes.set_title("How many shapes it takes", fontsize=SIZE_PT)


def _draw_controls(axes: "matplotlib.axes.Axes", numbers: Measurements) -> None:
    counts = numbers.controls
    axes.hist(counts, bins=min(40, max(1, int(np.ptp(counts)))), color=ACCENT)
    median = float(np.median(counts))
    axes.axvline(median, color=LINE, linewidth=1)
    axes.annotate(f"median {median:.0f}, most {counts.max()}", (median, 0.97), (5, 0), va="top",
                  xycoords=("data", "axes fraction"), textcoords="offset points", fontsize=SIZE_PT,
                  bbox={"facecolor": "white", "edgecolor": "none", "pad": 2, "alpha": 0.8})  # fmt: skip
    axes.set(xlabel="controls that can move a vertex", ylabel="vertices")
    axes.set_title("How many controls meet in a vertex", fontsize=SIZE_PT)
    tidy(axes)


def _draw_face(figure: "matplotlib.figure.Figure", axes: "matplotlib.axes.Axes", mesh: Mesh, numbers, renderer) -> None:
    corners = numbers.ratio[mesh.faces]
    finite = np.isfinite(corners).any(1)
    ratio = np.full(len(corners), np.nan)
    ratio[finite] = np.nanmean(corners[finite], axis=1)
    surface = Surface(mesh.neutral, mesh.faces, error_colours(ratio, RATIO_LIMIT), lit=False, smooth=False)
    axes.imshow(render([surface], camera_for("front", mesh.neutral), *FACE, renderer=renderer), interpolation="none")
    axes.set_axis_off()
    axes.set_title("Where controls interact", fontsize=SIZE_PT)
    bar = colour_bar(figure, axes.inset_axes((1.0, 0.1, 0.035, 0.8)), RATIO_LIMIT, "mixed over single differences")
    bar.set_ticks((0.0, 0.05, 0.1, 0.15))


def _draw_pairs(axes: "matplotlib.axes.Axes", numbers: Measurements) -> None:
    lines = numbers.pairs[:PAIRS]
    axes.barh(range(len(lines)), [line[4] for line in lines], color=SECOND)
    axes.set_yticks(range(len(lines)), [f"{_spoken(line[0])}\n× {_spoken(line[1])}" for line in lines])
    axes.invert_yaxis()
    share, count = (numbers.value("pairs", name) or 0.0 for name in ("interacting_share", "pairs"))
    axes.set_xlabel(f"largest mixed difference, mm;\nover 0.1 mm: {100 * share:.0f} %\nof {count:,.0f} pairs")
    axes.set_title("Which controls interact most", fontsize=SIZE_PT)
    tidy(axes)


def _spoken(control: str) -> str:
    """Return a control's name as a reader has it, short enough for the left of a chart."""
    return control.replace("_left", " L").replace("_right", " R").replace("_", " ")


def _draw_maps(axes: "matplotlib.axes.Axes", numbers: Measurements) -> None:
    sizes = map_sizes(numbers.rows)
    per_segment: dict[str, list[tuple[int, float]]] = {}
    for row in numbers.rows:
        if row.table == "rig_report_segments" and row.method == "maps" and row.metric.startswith("normal_error_mean["):
            size, name = row.metric[len("normal_error_mean[") : -1].split("][")
            if name != "rigid":  # they follow by their attachments, on maps of any size
                per_segment.setdefault(name, []).append((int(size), row.value))
    for points in per_segment.values():
        axes.plot(*np.transpose(sorted(points)), color="0.75", linewidth=0.8, label="a segment")
    whole = [numbers.value("maps", f"normal_error_mean[{size}]") for size in sizes]
    axes.plot(sizes, whole, "o-", color=ACCENT, label="all; vertices a texel")
    for size, degrees in zip(sizes, whole, strict=True):
        crowd = numbers.value("maps", f"vertices_per_texel[{size}]")
        axes.annotate(
            f"{crowd:.2g}", (size, degrees), (3, 5), textcoords="offset points", fontsize=SIZE_PT, color=ACCENT
        )
    axes.set_xscale("log", base=2)
    axes.set_yscale("log")
    axes.set_xticks(sizes, [f"{size}²" for size in sizes])
    axes.set(xlabel="texels of a segment's map", ylabel="mean normal error, degrees", ylim=(SMALLEST_DEG, None))
    handles = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    axes.legend(handles.values(), handles, edgecolor="white", fontsize=SIZE_PT, loc="upper right")
    axes.set_title("What maps of a size can hold", fontsize=SIZE_PT)
    tidy(axes)


def _words(numbers: Measurements) -> Words:
    fits = "; ".join(
        f"{LABELS[name]} {numbers.value(name, 'normal_error_mean'):.2f}° and "
        f"{round_off(numbers.value(name, 'vertex_error_mean'), 'mm')} mm"
        for name in BARS
    )
    share, ratio = (numbers.value("pairs", name) or 0.0 for name in ("interacting_share", "mixed_over_single"))
    tried = (
        f"{100 * share:.0f} % of the pairs tried change each other's effect by more than 0.1 mm somewhere.",
        f"Mixed differences of two controls are {100 * ratio:.1f} % of the single ones (root mean squares; grey: no "
        "pair of the draw moves it).",
    )
    if untried := numbers.value("pairs", "pairs") is None:
        tried = ("How its controls interact is not known: this rig is known by its samples alone.",) * 2
    panels = "Four" if untried else "Six"
    return Words(
        f"{panels} panels about the rig {numbers.character}. Mean errors of held-out poses: {fits}. "
        f"A vertex is moved by {np.median(numbers.controls):.0f} controls (median). {tried[0]}",
        f"How hard {numbers.character}'s rig is. Fits see rig parameters and predict coefficients of a PCA basis; "
        f"{features_text(numbers.value)} The basis alone is what no such fit can beat. {tried[1]} Maps hold the true "
        "offsets by least squares.",
    )
