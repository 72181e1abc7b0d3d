"""The pictures and the table of lesson 6."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from course.lesson6 import STEPS, Face
from replicate.approximation.metrics import normal_error, vertex_error
from replicate.approximation.samples import evaluate
from replicate.drawing.face_sheet import Cell, face_sheet
from replicate.drawing.panels import WIDTH, Words, enlarge, error_scale, tidy

if TYPE_CHECKING:
    import matplotlib.figure

COLOURS = {"line": "#56B4E9", "network": "#D55E00", "network beside the line": "#009E73"}
OTHERS = ("#CC79A7", "#E69F00", "#0072B2")


def curves(line: tuple[float, float], logs: Mapping[str, Sequence[tuple]]) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): both test errors over the steps of some trainings, and the line's.

    line: its errors, mm and degrees. logs: name → what `train` returned.
    """
    from matplotlib.figure import Figure

    figure = Figure((0.85 * WIDTH, 3.4), dpi=100, layout="constrained")
    labels = ("distance error, mm", "normal error, degrees")
    for k, axes in enumerate(figure.subplots(1, 2)):
        axes.axhline(line[k], color=COLOURS["line"], linewidth=2, linestyle="--", label="line")
        for place, (name, log) in enumerate(logs.items()):
            steps, colour = [row[0] for row in log], COLOURS.get(name, OTHERS[place % len(OTHERS)])
            axes.plot(steps, [row[1 + k] for row in log], "o-", color=colour, linewidth=2, ms=4, label=name)
        axes.set_xlabel("steps")
        axes.set_ylabel(labels[k])
        error_scale(axes, "y")
        tidy(axes)
        enlarge(axes, 13)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=3, frameon=False, fontsize=13)
    ends = "; ".join(f"{name} {log[-1][1]:.2f} mm, {log[-1][2]:.2f}°" for name, log in logs.items())
    return figure, Words(
        f"Two charts of test errors over {max(log[-1][0] for log in logs.values())} steps. The line stays at "
        f"{line[0]:.2f} mm and {line[1]:.2f}°; at the end: {ends}.",
        "Errors on poses of clips that training has no frame of. Both axes of errors are logarithmic.",
    )


LIMIT_DEG = 20.0
PANEL, TALL, SHEET = 235, 1.2, 1000  # width of a head in pixels, its height over that, and the width of all


def heads(face: Face, predictions: Mapping[str, np.ndarray]) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): the test pose whose normals turn most, by the rig and as some methods predict it.

    predictions: name → test offsets (b, n, 3) in mm.
    """
    from replicate.drawing.heatmap import middle_line, normal_bar, normal_heat, split_face
    from replicate.drawing.render import render
    from replicate.drawing.scene import Surface, camera_for, frame_surfaces

    turned = np.nanmean(normal_error(face.neutral + face.test_offsets, face.neutral, face.faces), axis=1)
    pose = int(np.argmax(turned))
    truth = face.neutral + face.test_offsets[pose]
    width, height = PANEL, round(TALL * PANEL)
    view = frame_surfaces(camera_for("front", face.neutral), [Surface(truth, face.faces)], 1 / TALL)
    draw = partial(render, camera=view, width=width, height=height)
    cells = [Cell("rig", (draw([Surface(truth, face.faces)]),))]
    for name, offsets in predictions.items():
        posed = face.neutral + offsets[pose]
        pictures = draw([Surface(posed, face.faces)]), draw([normal_heat(posed, truth, face.faces, LIMIT_DEG)])
        line = middle_line(face.neutral, posed, face.faces, view, width, height)
        mm, degrees = vertex_error(posed, truth).mean(), np.nanmean(normal_error(posed, truth, face.faces))
        cells.append(Cell(name, (split_face(*pictures, line),), (f"{mm:.2f} mm, {degrees:.1f}°",)))
    bar = partial(normal_bar, limit_deg=LIMIT_DEG, orientation="horizontal")
    numbers = "; ".join(f"{cell.title}: {cell.lines[0]}" for cell in cells[1:])
    return face_sheet(cells, len(cells), bar=bar, width=SHEET), Words(
        f"The tiny head by the rig and by {len(predictions)} methods, half of each face coloured by normal error. "
        f"{numbers}.",
        "The test pose whose normals turn most from rest. Left halves: surfaces; right halves: normal errors.",
    )


def products(functions: Mapping[str, Callable]) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): level curves of functions of two controls, (b, 2) → (b,), from 0 to 2."""
    from matplotlib.figure import Figure

    side = np.linspace(0, 2, 121, dtype=np.float32)
    pairs = np.stack(np.meshgrid(side, side), -1).reshape(-1, 2)
    figure = Figure((0.85 * WIDTH, 3.2), dpi=100, layout="constrained")
    for axes, (name, function) in zip(figure.subplots(1, len(functions), sharey=True), functions.items(), strict=True):
        values = np.asarray(function(pairs)).reshape(len(side), -1)
        levels = axes.contourf(side, side, values, np.linspace(-0.5, 4, 10), cmap="viridis", extend="both")
        axes.contour(side, side, values, np.linspace(-0.5, 4, 10), colors="white", linewidths=0.4)
        axes.plot([0, 1, 1, 0, 0], [0, 0, 1, 1, 0], color="white", linewidth=2)
        axes.set(title=name, xlabel="control $x$", xticks=(0, 1, 2), yticks=(0, 1, 2), aspect="equal")
        enlarge(axes, 13)
    figure.axes[0].set_ylabel("control $y$", fontsize=13)
    bar = figure.colorbar(levels, ax=figure.axes, shrink=0.8, ticks=(0, 1, 2, 3, 4))
    bar.ax.tick_params(labelsize=13)
    return figure, Words(
        f"Level curves of {len(functions)} functions of two controls from 0 to 2: {', '.join(functions)}.",
        "Values over two controls. White square: where training poses are, for controls are divided by their largest "
        "value in training, which has the random factors of Eq. 5 in it.",
    )


def balances(logs: Mapping[float, Sequence[tuple]], line: tuple[float, float], rest: tuple[float, float]):
    """Return (figure, words): the errors that networks end with, one for each α.

    logs: α → what `train` returned. line, rest: errors of the line and of the face at rest, mm and degrees.
    """
    from matplotlib.figure import Figure

    figure = Figure((WIDTH, 4.0), dpi=100, layout="constrained")
    axes = figure.add_subplot()
    ends = sorted((alpha, *log[-1][1:]) for alpha, log in logs.items())
    axes.plot([mm for _, mm, _ in ends], [deg for *_, deg in ends], "o-", color=COLOURS["network"], linewidth=1, ms=9)
    for place, (alpha, mm, degrees) in enumerate(ends):  # one above its dot, the next one below
        beside = (0, 12 if place % 2 == 0 else -24)
        axes.annotate(f"α = {alpha:g}", (mm, degrees), beside, textcoords="offset points", ha="center")
    axes.plot(*line, "x", color=COLOURS["line"], ms=9, mew=3)
    axes.set_title(f"at {max(log[-1][0] for log in logs.values())} steps")
    axes.annotate("line", line, (12, -4), textcoords="offset points")
    axes.plot(*rest, "s", color="0.4", ms=8)
    axes.annotate("face at rest", rest, (-12, -4), textcoords="offset points", ha="right")
    axes.set(xlabel="distance error, mm", ylabel="normal error, degrees")
    axes.set_xlim(0, 1.1 * max(rest[0], ends[-1][1]))
    axes.set_ylim(0, 1.1 * max(rest[1], max(deg for *_, deg in ends)))
    tidy(axes)
    enlarge(axes, 13)
    words = "; ".join(f"α = {alpha:g}: {mm:.2f} mm, {degrees:.2f}°" for alpha, mm, degrees in ends)
    return figure, Words(
        f"A chart of normal error over distance error. {words}; the line {line[0]:.2f} mm, {line[1]:.2f}°; the face at "
        f"rest {rest[0]:.2f} mm, {rest[1]:.2f}°.",
        f"The same network after {STEPS} steps on Eq. 1, with positions in mm and four α.",
    )


REGIONS, TOUCHES_MM, WIDE = 8, 0.05, 600  # the last one in pixels


def controls_of_regions(face: Face) -> tuple[np.ndarray, np.ndarray]:
    """Return each vertex's region (n,), and which controls move each region (r, m) when they are alone at a limit."""
    from replicate.regional.basis import split_regions

    region = np.empty(len(face.neutral), np.int64)
    for k, members in enumerate(split_regions(face.neutral, REGIONS)):
        region[members] = k
    limits = np.concatenate([np.diag(face.rig.lower), np.diag(face.rig.upper)]).astype(np.float32)
    posed = np.concatenate([vertices for _, vertices in evaluate(face.rig, limits)])
    moved = vertex_error(posed, face.neutral) > TOUCHES_MM  # (2m, n)
    by_control = moved.reshape(2, -1, len(region)).any(0)
    return region, np.stack([by_control[:, region == k].any(1) for k in range(REGIONS)])


def regions(face: Face) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): regions of the tiny head, and how many controls each of them sees."""
    from replicate.drawing.heatmap import colour_bar, error_colours
    from replicate.drawing.light import EVEN
    from replicate.drawing.render import render
    from replicate.drawing.rig_views import DISTINCT
    from replicate.drawing.scene import Surface, camera_for, frame_surfaces

    region, seen = controls_of_regions(face)
    counts, most = seen.sum(1), seen.shape[1]
    palette = np.array(DISTINCT[:REGIONS], np.uint8)
    heat = error_colours(counts.astype(np.float64), most)
    of_face = region[face.faces[:, 0]]
    surfaces = [Surface(face.neutral, face.faces, colours[of_face]) for colours in (palette, heat)]
    view = frame_surfaces(camera_for("three_quarter", face.neutral), surfaces, 1 / TALL)
    pictures = [
        render([surface], view, WIDE // 2 - 60, round(TALL * (WIDE // 2 - 60)), studio=EVEN) for surface in surfaces
    ]
    cells = [Cell(title, (each,)) for title, each in zip(("regions", "controls they see"), pictures, strict=True)]
    bar = partial(colour_bar, limit=most, label=f"controls that move the region, of {most}", orientation="horizontal")
    return face_sheet(cells, len(cells), bar=bar, width=WIDE), Words(
        f"The tiny head twice, in {REGIONS} colours for its regions, and coloured by how many of {most} controls "
        f"move each: {', '.join(map(str, sorted(counts)))}.",
        f"A control is counted where it moves a vertex of the region by more than {TOUCHES_MM:g} mm at one of its "
        "limits, all others at rest.",
    )


PIECES = {
    "removed": (
        "no straight line",
        "leaky ReLUs, no products",
        "squared errors",
        "one region, as many bytes",
        "components of positions alone",
    ),
    "added": ("a network for each region", "the same, each of its region's controls"),
}


def pieces(results: str = "reference", character: str = "teen"):
    """Return a table: both validation errors of changed regional methods, over those of one network for all regions."""
    import pandas

    import replicate
    from replicate.benchmarks.bench_regional import ONE

    frame = replicate.results(results).query("table == 'bench_regional' and character == @character")
    values = dict(zip(frame["metric"], frame["value"], strict=True))
    names = {"mm": "validation_vertex_error", "degrees": "validation_normal_error"}
    rows = [(kind, piece) for kind, pieces_of in PIECES.items() for piece in pieces_of]
    table = {
        unit: [values[f"{name}[{piece}]"] / values[f"{name}[{ONE}]"] for _, piece in rows]
        for unit, name in names.items()
    }
    table = pandas.DataFrame(table, index=pandas.MultiIndex.from_tuples(rows)).map("× {:.2f}".format)
    size = [f"{values[f'model_size[{piece}]']:.1f} MB, not {values[f'model_size[{ONE}]']:.1f}" for _, piece in rows]
    return table.assign(size=size)
