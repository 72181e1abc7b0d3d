"""The rig report in tables and a figure: all characters side by side, and each in full."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from replicate.drawing.heatmap import colour_bar, error_colours
from replicate.drawing.panels import DPI, LETTER_PT, WIDTH, Words, enlarge, error_scale, tidy
from replicate.drawing.render import render
from replicate.drawing.scene import Surface, camera_for
from replicate.geometry.mesh import Mesh
from replicate.methods.method_registry import in_order, method_named
from replicate.report.results import Row, characters_of, find
from replicate.report.tables import Table, our_value, round_off
from replicate.targets.rig_report.rows import LENGTHS, read_pairs

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.figure


TABLE = "rig_report"
STATISTICS = ("mean", "p95", "max")
KINDS = (("vertex", "mm", "Distance error, mm"), ("normal", "deg", "Normal angle error, degrees"))
UNTRIED = "–: a rig that is known by its samples alone; no pair of its controls can be tried."
COUNTS = {
    "99 % of variance": "99 % of the variance",
    "99.9 % of variance": "99.9 %",
    "99.99 % of variance": "99.99 %",
    "0.5 degrees": "a mean normal error of 0.5°",
    "0.25 degrees": "of 0.25°",
}


def report_table(rows: Sequence[Row]) -> Table:
    """Return the means of all characters side by side."""
    characters = characters_of(rows)
    body: list[tuple[str, ...] | None] = []
    for kind, unit, words in KINDS:
        body.append(_heading(f"{words}, mean over held-out poses", characters))
        body += [_line(rows, characters, label, name, f"{kind}_error_mean", unit) for name, label in LABELS.items()]
    body += [None, _heading("Principal components for", characters)]
    body += [(words, *(_count(rows, c, f"components[{key}]") for c in characters)) for key, words in COUNTS.items()]
    body += [None, _heading("Controls that can move a vertex", characters)]
    body += [
        _line(rows, characters, word, "influence", f"controls_per_vertex_{word}", "count")
        for word in ("mean", "median", "max")
    ]
    body += [None, _heading("Pairs of controls", characters)]
    body.append(_line(rows, characters, "that interact by more than 0.1 mm", "pairs", "interacting_share", "%"))
    body.append(_line(rows, characters, "mixed over single differences, RMS", "pairs", "mixed_over_single", "%"))
    body += [None, _heading("Normal error of the truth on maps, degrees", characters)]
    body += [
        _line(rows, characters, f"{size}×{size} texels a segment", "maps", f"normal_error_mean[{size}]", "deg")
        for size in map_sizes(rows)
    ]
    tried = {row.character for row in rows if row.method == "pairs"}
    notes = (_about(rows), *((UNTRIED,) if set(characters) - tried else ()))
    return Table("How hard is a rig?", (("", *characters),), tuple(body), notes)


def errors_table(rows: Sequence[Row], character: str) -> Table:
    """Return one character's held-out errors in full."""
    body = tuple((label, *_errors(rows, TABLE, character, name)) for name, label in LABELS.items())
    headers = (
        ("", "distance error, mm", "", "", "normal angle error, degrees", "", ""),
        ("", *STATISTICS, *STATISTICS),
    )
    features = features_text(lambda method, metric: _value(rows, character, method, metric))
    samples = _value(rows, character, "linear", "samples")
    notes = (f"Fitted to {samples:,.0f} training samples. {features}",) if samples else ()
    return Table(f"Held-out errors of simple fits: {character}", headers, body, notes)


def pairs_table(file: Path, character: str) -> Table | None:
    """Return the pairs of controls in a file of `write_pairs`, the strongest first; None if none was tried."""
    lines = read_pairs(file).to_dict("records")
    if not lines:
        return None
    body = tuple(
        (f"{line['first']} × {line['second']}", line["segment"], line["pose"],
         *(round_off(line[name], "mm") for name in LENGTHS))
        for line in lines
    )  # fmt: skip
    header = ("", "segment", "from pose", "mixed, mm", "first alone", "second alone")
    return Table(f"Pairs of {character}'s controls that interact most", (header,), body, text_columns=3)


def beside_table2(table2: Sequence[Row], report: Sequence[Row], character: str) -> Table | None:
    """Return a character's mean errors of Table 2's methods and of the report's fits; None if either is missing."""
    rows = [row for row in table2 if row.table == "table2" and row.character == character]
    if not rows or not any(row.character == character for row in report):
        return None
    lines = [(method_named(m).title, _errors(rows, "table2", character, m)) for m in in_order({r.method for r in rows})]
    fits = [(f"Regression on {LABELS[name]}", name) for name in ("linear", "squares", "products")]
    fits.append(("PCA basis of these regressions", "basis"))
    lines += [None, *((label, _errors(report, TABLE, character, name)) for label, name in fits)]
    body = tuple(line and (line[0], line[1][0], line[1][3]) for line in lines)
    header = ("mean over held-out poses", "distance error, mm", "normal angle error, degrees")
    note = "From `make rig-report`: ridge regressions of all rig parameters to PCA coefficients of the whole mesh."
    return Table(f"Table 2 beside simple fits: {character}", (header,), body, (note,))


def report_card(rows: Sequence[Row]) -> Table:
    """Return the table of the data card, a line for each character."""
    body = []
    for character in characters_of(rows):
        degrees = (_value(rows, character, name, "normal_error_mean") for name in ("neutral", "linear", "products"))
        body.append((
            character,
            *(round_off(value, "deg") for value in degrees),
            _count(rows, character, "components[99.9 % of variance]"),
            _count(rows, character, "components[0.25 degrees]"),
            round_off(_value(rows, character, "influence", "controls_per_vertex_median"), "count"),
            _percent(_value(rows, character, "pairs", "interacting_share")),
            _percent(_value(rows, character, "pairs", "mixed_over_single")),
        ))  # fmt: skip
    header = ("", "neutral pose, °", "straight line, °", "with products, °", "components for 99.9 %", "for 0.25°",
              "controls a vertex", "pairs > 0.1 mm", "mixed / single")  # fmt: skip
    return Table("How hard the rigs are", (header,), tuple(body))


def map_sizes(rows: Sequence[Row]) -> list[int]:
    """Return the widths of the maps in the rows, in pixels."""
    metrics = {row.metric for row in rows if row.table == TABLE and row.method == "maps"}
    return sorted(int(metric.partition("[")[2][:-1]) for metric in metrics if metric.startswith("normal_error"))


def _value(rows: Sequence[Row], character: str, method: str, metric: str) -> float | None:
    row = find(rows, TABLE, character, method, metric)
    return row.value if row else None


def _count(rows: Sequence[Row], character: str, metric: str) -> str:
    """Return a count of components, or "> 512" if all 512 don't suffice."""
    count, most = (_value(rows, character, "basis", name) for name in (metric, "components"))
    return f"> {most:,.0f}" if count is None and most else round_off(count, "count")


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{value:.1%}".replace("%", " %")


def _heading(words: str, characters: Sequence[str]) -> tuple[str, ...]:
    return (words, *[""] * len(characters))


def _line(
    rows: Sequence[Row], characters: Sequence[str], label: str, method: str, metric: str, unit: str
) -> tuple[str, ...]:
    cells = []
    for character in characters:
        row = find(rows, TABLE, character, method, metric)
        if unit == "%":
            cells.append(_percent(row.value if row else None))
        else:
            cells.append(our_value(row))
    return (f"– {label}", *cells)


def _errors(rows: Sequence[Row], table: str, character: str, method: str) -> tuple[str, ...]:
    cells = []
    for kind, _, _ in KINDS:
        for statistic in STATISTICS:
            row = find(rows, table, character, method, f"{kind}_error_{statistic}")
            cells.append(our_value(row))
    return tuple(cells)


def _about(rows: Sequence[Row]) -> str:
    profiles = ", ".join(sorted({row.profile for row in rows}))
    return (
        f"Profile {profiles}. Fits: ridge regressions from all rig parameters p to coefficients of a PCA basis of the "
        "whole mesh; “> k”: more than the k components that there are."
    )


# The report of one character as a figure of six panels.

LINE, ACCENT, SECOND = "#555555", "#0072B2", "#D55E00"
BARS = {"neutral": "#BBBBBB", "linear": "#56B4E9", "squares": "#0072B2", "products": "#003F66", "basis": "#009E73"}
RATIO_LIMIT = 0.15  # upper end of the heatmap's colours, the same for every character
FACE = (396, 446)  # pixels
SIZE = (WIDTH, 14.5)  # inches
ROWS = (1.0, 1.0, 1.35)  # the heights of rows, in proportion
SIZE_PT = LETTER_PT
PAIRS = 6  # pairs that are shown; the CSV file has more
SMALLEST_DEG = 0.01  # lower end of the axis of the maps' errors; smaller ones can't be seen on a face


@dataclass(frozen=True)
class Measurements:
    """What the figure shows of a character.

    rows: its rows of rig_report.csv
    pairs: its strongest pairs, with the columns of `PAIR_COLUMNS`
    spectrum: each component's share of the variance, (c,)
    curve: pairs (components, mean normal error in degrees)
    controls: how many controls move each vertex, (n,)
    ratio: mixed over single differences at each vertex, (n,); NaN where no pair that was tried moves it
    """

    character: str
    rows: Sequence[Row]
    pairs: Sequence[tuple]
    spectrum: np.ndarray
    curve: Sequence
    controls: np.ndarray
    ratio: np.ndarray

    def value(self, method: str, metric: str) -> float | None:
        """Return the value of a row, or None."""
        row = find(self.rows, "rig_report", self.character, method, metric)
        return row.value if row else None


def report_figure(mesh: Mesh, measured: Measurements) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): errors of fits, components, controls for a vertex, map sizes, and interaction twice.

    The last two are left out if no pairs were tried.
    """
    from matplotlib.figure import Figure

    tried = measured.value("pairs", "pairs") is not None  # not of a rig that is known by its samples alone
    heights = ROWS if tried else ROWS[:2]
    figure = Figure((SIZE[0], SIZE[1] * sum(heights) / sum(ROWS)), dpi=DPI, layout="constrained")
    rows = figure.subfigures(len(heights), 1, height_ratios=heights)  # each finds room for its own names
    (errors, components), (controls, maps), *more = (row.subplots(1, 2) for row in rows)
    _draw_errors(errors, measured)
    _draw_components(components, measured)
    _draw_controls(controls, measured)
    _draw_maps(maps, measured)
    for face, pairs in more:
        _draw_face(figure, face, mesh, measured)
        _draw_pairs(pairs, measured)
    for axes in (*figure.axes, *(child for each in figure.axes for child in each.child_axes)):
        axes.tick_params(which="both", labelsize=SIZE_PT)
        for label in (axes.xaxis.label, axes.yaxis.label):
            label.set_fontsize(SIZE_PT)
    figure.suptitle(f"How hard is a rig? {measured.character}: {len(mesh.neutral):,} vertices, "
                    f"{measured.value('influence', 'controls'):,.0f} controls", fontsize=SIZE_PT)  # fmt: skip
    return figure, _words(measured)


def _draw_errors(axes: "matplotlib.axes.Axes", measured: Measurements) -> None:
    names = [name for name in BARS if measured.value(name, "normal_error_mean") is not None]
    degrees = [measured.value(name, "normal_error_mean") for name in names]
    axes.barh(range(len(names)), degrees, color=[BARS[name] for name in names])
    for y, name in enumerate(names):
        millimetres = round_off(measured.value(name, "vertex_error_mean"), "mm")
        axes.annotate(f"{degrees[y]:.2f}°, {millimetres} mm", (degrees[y], y), (4, 0), textcoords="offset points",
                      va="center", fontsize=SIZE_PT)  # fmt: skip
    axes.set_yticks(range(len(names)), [LABELS[name] for name in names], fontsize=SIZE_PT)
    axes.set_xlim(0, 2.6 * max(degrees, default=1.0))
    axes.invert_yaxis()
    axes.set_xlabel("mean normal error, degrees")
    axes.set_title("What simple fits miss", fontsize=SIZE_PT)
    tidy(axes)


def _draw_components(axes: "matplotlib.axes.Axes", measured: Measurements) -> None:
    from matplotlib.ticker import LogLocator

    left = np.maximum(1 - np.cumsum(measured.spectrum), 1e-9)
    axes.plot(np.arange(1, len(left) + 1), left, color=LINE)
    axes.set(xscale="log", yscale="log", xlabel="principal components", xlim=(0.9, 4 * len(left)))
    axes.set_ylabel("variance left", color=LINE)
    counts = []
    for share in ("99", "99.9", "99.99"):
        count = measured.value("basis", f"components[{share} % of variance]")
        if count is not None:
            axes.plot(count, left[int(count) - 1], "o", color=LINE)
            counts.append(f"{share} %: {count:.0f}")
    style = {"xycoords": "axes fraction", "fontsize": SIZE_PT}  # both curves fall, so these corners are empty
    axes.annotate("\n".join(counts), (0.04, 0.04), color=LINE, **style)
    tidy(axes)
    degrees = axes.twinx()
    degrees.plot(*np.transpose(measured.curve), "-", color=SECOND)
    degrees.set_yscale("log")
    degrees.set_ylabel("mean normal error, degrees", color=SECOND)
    counts = []
    for limit in ("0.5", "0.25"):
        count = measured.value("basis", f"components[{limit} degrees]")
        if count is not None:
            degrees.plot(count, float(limit), "o", color=SECOND)
        counts.append(f"{limit}°: > {len(left)}" if count is None else f"{limit}°: {count:.0f}")
    degrees.annotate("\n".join(counts), (0.97, 0.96), color=SECOND, ha="right", va="top", **style)
    degrees.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    degrees.yaxis.set_major_formatter("{x:g}")
    degrees.yaxis.set_minor_formatter("")
    degrees.spines[["top"]].set_visible(False)
    axes.set_title("How many shapes it takes", fontsize=SIZE_PT)


def _draw_controls(axes: "matplotlib.axes.Axes", measured: Measurements) -> None:
    counts = measured.controls
    axes.hist(counts, bins=min(40, max(1, int(np.ptp(counts)))), color=ACCENT)
    median = float(np.median(counts))
    axes.axvline(median, color=LINE, linewidth=1)
    axes.annotate(f"median {median:.0f}, most {counts.max()}", (median, 0.97), (5, 0), va="top",
                  xycoords=("data", "axes fraction"), textcoords="offset points", fontsize=SIZE_PT,
                  bbox={"facecolor": "white", "edgecolor": "none", "pad": 2, "alpha": 0.8})  # fmt: skip
    axes.set(xlabel="controls that can move a vertex", ylabel="vertices")
    axes.set_title("How many controls meet in a vertex", fontsize=SIZE_PT)
    tidy(axes)


def _draw_face(figure: "matplotlib.figure.Figure", axes: "matplotlib.axes.Axes", mesh: Mesh, measured) -> None:
    corners = measured.ratio[mesh.faces]
    finite = np.isfinite(corners).any(1)
    ratio = np.full(len(corners), np.nan)
    ratio[finite] = np.nanmean(corners[finite], axis=1)
    surface = Surface(mesh.neutral, mesh.faces, error_colours(ratio, RATIO_LIMIT), lit=False)
    axes.imshow(render([surface], camera_for("front", mesh.neutral), *FACE), interpolation="none")
    axes.set_axis_off()
    axes.set_title("Where controls interact", fontsize=SIZE_PT)
    bar = colour_bar(figure, axes.inset_axes((1.0, 0.1, 0.035, 0.8)), RATIO_LIMIT, "mixed over single differences")
    bar.set_ticks((0.0, 0.05, 0.1, 0.15))


def _draw_pairs(axes: "matplotlib.axes.Axes", measured: Measurements) -> None:
    lines = measured.pairs[:PAIRS]
    axes.barh(range(len(lines)), [line[4] for line in lines], color=SECOND)
    axes.set_yticks(range(len(lines)), [f"{_spoken(line[0])}\n× {_spoken(line[1])}" for line in lines])
    axes.invert_yaxis()
    share, count = (measured.value("pairs", name) or 0.0 for name in ("interacting_share", "pairs"))
    axes.set_xlabel(f"largest mixed difference, mm;\nover 0.1 mm: {100 * share:.0f} %\nof {count:,.0f} pairs")
    axes.set_title("Which controls interact most", fontsize=SIZE_PT)
    tidy(axes)


def _spoken(control: str) -> str:
    """Return a control's name in words, short enough for the left of a chart."""
    return control.replace("_left", " L").replace("_right", " R").replace("_", " ")


def _draw_maps(axes: "matplotlib.axes.Axes", measured: Measurements) -> None:
    sizes = map_sizes(measured.rows)
    per_segment: dict[str, list[tuple[int, float]]] = {}
    for row in measured.rows:
        if row.table == "rig_report_segments" and row.method == "maps" and row.metric.startswith("normal_error_mean["):
            size, name = row.metric[len("normal_error_mean[") : -1].split("][")
            if name != "rigid":  # they follow by their attachments, on maps of any size
                per_segment.setdefault(name, []).append((int(size), row.value))
    for points in per_segment.values():
        axes.plot(*np.transpose(sorted(points)), color="0.75", linewidth=0.8, label="a segment")
    whole = [measured.value("maps", f"normal_error_mean[{size}]") for size in sizes]
    axes.plot(sizes, whole, "o-", color=ACCENT, label="all; vertices a texel")
    for size, degrees in zip(sizes, whole, strict=True):
        crowd = measured.value("maps", f"vertices_per_texel[{size}]")
        axes.annotate(
            f"{crowd:.2g}", (size, degrees), (3, 5), textcoords="offset points", fontsize=SIZE_PT, color=ACCENT
        )
    axes.set_xlim(0.8 * sizes[0], 2.2 * sizes[-1])  # room for the last of these numbers
    axes.set_xscale("log", base=2)
    axes.set_yscale("log")
    axes.set_xticks(sizes, [f"{size}²" for size in sizes])
    axes.set(xlabel="texels of a segment's map", ylabel="mean normal error, degrees")
    axes.set_ylim(SMALLEST_DEG, 10 * axes.get_ylim()[1])  # the legend stands above all lines
    handles = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    axes.legend(handles.values(), handles, edgecolor="white", fontsize=SIZE_PT, loc="upper right")
    axes.set_title("What maps of a size can hold", fontsize=SIZE_PT)
    tidy(axes)


def _words(measured: Measurements) -> Words:
    fits = "; ".join(
        f"{LABELS[name]} {measured.value(name, 'normal_error_mean'):.2f}° and "
        f"{round_off(measured.value(name, 'vertex_error_mean'), 'mm')} mm"
        for name in BARS
    )
    share, ratio = (measured.value("pairs", name) or 0.0 for name in ("interacting_share", "mixed_over_single"))
    tried = (
        f"{100 * share:.0f} % of the pairs tried change each other's effect by more than 0.1 mm somewhere.",
        f"Mixed differences of two controls are {100 * ratio:.1f} % of the single ones (root mean squares; grey: no "
        "pair of the draw moves it).",
    )
    if untried := measured.value("pairs", "pairs") is None:
        tried = ("How its controls interact is not known: this rig is known by its samples alone.",) * 2
    panels = "Four" if untried else "Six"
    return Words(
        f"{panels} panels about the rig {measured.character}. Mean errors of held-out poses: {fits}. "
        f"A vertex is moved by {np.median(measured.controls):.0f} controls (median). {tried[0]}",
        f"How hard {measured.character}'s rig is. Fits see rig parameters and predict coefficients of a PCA basis; "
        f"{features_text(measured.value)} The basis alone is what no such fit can beat. {tried[1]} Maps hold the true "
        "offsets by least squares.",
    )


# All rigs in a chart, for the page about them.

FITS = ("linear", "squares", "products")
RIGS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")  # colours of rigs, in turn
LINE_HEIGHT = 0.5  # inches for each rig


def share_chart(
    rows: Sequence[Row], labels: Mapping[str, str] | None = None
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): which share of the neutral pose's normal error each fit leaves, a line for each rig.

    labels: character → what the chart calls it, from above to below; by default all characters by their names.
    """
    from matplotlib.figure import Figure

    labels = labels or {character: character for character in characters_of(rows)}
    figure = Figure((WIDTH, 1.5 + LINE_HEIGHT * len(labels)), dpi=DPI, layout="constrained")
    axes, phrases = figure.subplots(), []
    for y, (character, label) in enumerate(labels.items()):
        neutral, *errors = (_value(rows, character, name, "normal_error_mean") for name in ("neutral", *FITS))
        shares = {name: 100 * error / neutral for name, error in zip(FITS, errors, strict=True) if error and neutral}
        axes.plot([*shares.values()], [y] * len(shares), color="0.8", linewidth=3, zorder=1)
        for name, share in shares.items():
            axes.plot(share, y, "o", color=BARS[name], markersize=12, label="" if y else LABELS[name])
        phrases.append(f"{label}: {', '.join(f'{share:.0f} %' for share in shares.values())}")
    axes.set_yticks(range(len(labels)), labels.values())
    axes.set_ylim(len(labels) - 0.5, -0.5)
    axes.set_xlim(left=0)
    axes.set_xlabel("share of the neutral pose's normal error that is left, %")
    tidy(axes)
    enlarge(axes)
    figure.legend(loc="outside upper center", ncols=len(FITS), frameon=False, fontsize=SIZE_PT)
    return figure, Words(
        f"A dot chart of what a straight line, squares and products leave. {'; '.join(phrases)}.",
        "Which share of the motion each fit leaves, in normals: from a straight line (light) over squares to products "
        "of two controls (dark). A long line is a rig whose controls interact.",
    )


def maps_chart(rows: Sequence[Row]) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): the normal error of the true offsets on maps, by the maps' size, a line for each rig."""
    from matplotlib.figure import Figure

    figure = Figure((WIDTH, 4.6), dpi=DPI, layout="constrained")
    axes, sizes, phrases = figure.subplots(), map_sizes(rows), []
    for colour, character in zip(itertools.cycle(RIGS), characters_of(rows), strict=False):
        errors = [_value(rows, character, "maps", f"normal_error_mean[{size}]") for size in sizes]
        axes.plot(sizes, [np.nan if error is None else error for error in errors], "o-", color=colour, label=character)
        phrases.append(f"{character}: {', '.join(round_off(error, 'deg') for error in errors)}")
    axes.set_xscale("log", base=2)
    axes.set_xticks(sizes, [f"{size}²" for size in sizes])
    axes.set(xlabel="texels of a segment's map", ylabel="mean normal error, degrees")
    error_scale(axes, "y")
    tidy(axes)
    enlarge(axes)
    figure.legend(loc="outside right upper", frameon=False, fontsize=SIZE_PT)
    return figure, Words(
        f"A line chart of normal errors in degrees by the size of maps, {', '.join(map(str, sizes))}. "
        f"{'; '.join(phrases)}.",
        "What maps can hold of the true offsets: the normal error that is left, both axes logarithmic.",
    )


# The names of the fits.

LABELS = {
    "neutral": "neutral pose",
    "linear": "p, a straight line",
    "squares": "p, abs(p), p²",
    "products": "p, abs(p), p², products",
    "basis": "the basis alone",
}


def features_text(value: Callable[[str, str], float | None]) -> str:
    """Return how many features each fit has, in a sentence. value: (method, metric) → its value or None."""
    counts = {LABELS[name]: value(name, "features") for name in ("linear", "squares", "products")}
    return "; ".join(f"{label}: {count:,.0f} features" for label, count in counts.items() if count is not None) + "."
