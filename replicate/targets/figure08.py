"""Figure 8: the refinement segments in colours."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, UInt8

from data_recipes.rig import Rig
from replicate.approximation.segments import Segment
from replicate.cli.running import make
from replicate.drawing.face_sheet import LETTER, WIDTH
from replicate.drawing.panels import DPI, Words, as_picture, save_figure
from replicate.drawing.rig_views import (
    DISTINCT,
    UNUSED_COLOUR,
    coloured_views,
    hexadecimal,
    legend_panel,
    read_lines,
    write_lines,
)
from replicate.engine.stage import Stage, StageContext
from replicate.geometry.mesh import Mesh
from replicate.methods import artefacts
from replicate.methods.method import Method
from replicate.methods.plan import Plan
from replicate.report.pose_record import with_layout
from replicate.report.publication import publish_pictures
from replicate.report.tables import Table
from replicate.targets.shown_records import Picture

if TYPE_CHECKING:
    import matplotlib.figure


def stages(plan: Plan, methods: Sequence[Method] = ()) -> list[Stage]:
    """Return the stage that draws one character's figure."""
    inputs = (artefacts.rig_stage(plan), artefacts.squares_stage(plan))
    return [plan.stage("figure08", draw, Picture(plan.character, plan.config.seed), *inputs)]


def draw(context: StageContext) -> None:
    """Draw the refinement segments in colours, what is unused in grey (Fig. 8)."""
    squares, errors = artefacts.load_squares(context.inputs), artefacts.load_map_error(context.inputs)
    stem = context.out / f"figure08_{context.config.character}"
    save_refinement_figure(artefacts.load_rig(context.inputs), squares, errors, stem)


def run(options: argparse.Namespace) -> None:
    """Draw the figure of every character and publish it."""
    publish_pictures("figure08", make(options, stages))


# Figure 8: the refinement segments (§3.3) in colours, the rest of the mesh in grey.

HEADER = (
    "segment", "chart", "vertices", "parameters", "u_low", "u_high", "v_low", "v_high", "map_error_mm", "error_share",
    "colour",
)  # fmt: skip


def refinement_colours(mesh: Mesh, segments: Sequence[Segment]) -> UInt8[np.ndarray, "f 3"]:
    """Return each face's colour: that of the last segment that it touches, grey where it touches none."""
    colours = np.full((len(mesh.faces), 3), UNUSED_COLOUR, np.uint8)
    for k, segment in enumerate(segments):
        mask = np.zeros(len(mesh.neutral), bool)
        mask[segment.vertices] = True
        colours[mask[mesh.faces].any(1)] = DISTINCT[k % len(DISTINCT)]
    return colours


def segment_lines(mesh: Mesh, segments: Sequence[Segment], errors: Float[np.ndarray, " n"]) -> list[tuple]:
    """Return a line with the columns of `HEADER` for each segment, and one for all other vertices together.

    errors: e_i of Eq. 2 in mm². map_error_mm is the root of its mean over the segment's vertices, error_share the
    segment's part of the sum; u and v are the extents of the segment's vertices in their chart.
    """
    total, lines = float(errors.sum()) or 1.0, []
    unused = np.ones(len(errors), bool)
    for k, segment in enumerate(segments):
        unused[segment.vertices] = False
        inside, uv = errors[segment.vertices], mesh.uv[segment.vertices]
        extents = uv.min(0), uv.max(0)
        lines.append(
            (
                segment.name,
                segment.name.rpartition("_")[0],
                len(segment.vertices),
                len(segment.parameters),
                *(float(end[axis]) for axis in (0, 1) for end in extents),
                float(np.sqrt(inside.mean())),
                float(inside.sum()) / total,
                hexadecimal(DISTINCT[k % len(DISTINCT)]),
            )
        )
    rest = errors[unused]
    root = float(np.sqrt(rest.mean())) if len(rest) else 0.0
    lines.append(
        ("unused", "", len(rest), "", "", "", "", "", root, float(rest.sum()) / total, hexadecimal(UNUSED_COLOUR))
    )
    return lines


def figure08(
    rig: Rig, segments: Sequence[Segment], errors: Float[np.ndarray, " n"], name: str, across: int | None = None
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Draw the refinement segments on the head and in their charts, and return (figure, words).

    segments: what §3.3 selected
    errors: e_i of Eq. 2, (n,), mm²
    name: the character's name in results
    across: as for `coloured_views`
    """
    mesh, whose = rig.mesh, with_layout(name, rig.mesh.segment_names)
    *lines, rest = segment_lines(mesh, segments, errors)
    shares = {line[0]: line[HEADER.index("error_share")] for line in lines}
    legend = [
        (f"{percent(shares[line[0]])} in {in_words(line[0])} ({line[2]:,})", [DISTINCT[k % len(DISTINCT)]])
        for k, line in enumerate(lines)
    ]
    share = percent(rest[HEADER.index("error_share")])
    legend.append((f"{share} in no square ({rest[2]:,})", [UNUSED_COLOUR]))
    colours = refinement_colours(mesh, segments)
    charts = charts_in_rows(chart_panels(mesh, segments, colours))
    key = legend_panel(legend, "share of the maps' error in each square (and how many vertices it has)")
    figure = coloured_views(rig, colours, [*charts, key], across)
    parts = "; ".join(f"{percent(share)} in {in_words(name)}" for name, share in shares.items())
    return figure, Words(
        f"The character {whose}, mouth open, from the front, from three-quarters and close up into the mouth; "
        f"{len(segments)} square patches are in colours of their own, all else is grey. Below: the charts that "
        "they lie in, with a rectangle around each.",
        f"Refinement segments of {whose}, after Fig. 8: {len(segments)} squares of the texture coordinates, as "
        "many as the elbow method asks for, around the centroids of the coarse maps' error (Eq. 2). Their parts of "
        f"that error: {parts}. A mesh face is coloured if it touches a refined vertex; grey: not refined. Below: the "
        "same in texture coordinates, chart by chart. Each rectangle is what a finer map covers; it ends at the "
        "outermost refined vertices, so that coloured faces reach beyond it. Eyeballs are for display only.",
    )


def in_words(segment: str) -> str:
    """Return a refinement segment's name in words: face_1_2 is the second square of the chart face_1."""
    chart, _, square = segment.rpartition("_")
    return f"{chart.replace('_', ' ')}, square {square}"


def percent(share: float) -> str:
    """Return a share in whole percent, or "< 1%" where it would round to 0."""
    return "< 1%" if 0 < share < 0.005 else f"{share:.0%}"


def save_refinement_figure(rig: Rig, segments: Sequence[Segment], errors: Float[np.ndarray, " n"], stem: Path) -> None:
    """Write Figure 8 of a rig as PNG, its words as JSON, and each segment's numbers as CSV.

    stem: "…/figure08_teen", which ends with the character's name.
    """
    figure, words = figure08(rig, segments, errors, stem.name.partition("_")[2])
    save_figure(figure, stem.with_suffix(".png"), words)
    write_lines(stem.with_suffix(".csv"), HEADER, segment_lines(rig.mesh, segments, errors))


def refinement_table(file: Path, character: str) -> Table:
    """Return the numbers behind a character's Figure 8: a line for each segment, and the rest of the mesh."""
    body: list[tuple[str, ...] | None] = []
    for line in read_lines(file, HEADER):
        unused = line["segment"] == "unused"
        body += [None] if unused else []
        extents = (f"{float(line[f'{axis}_low']):.2f}–{float(line[f'{axis}_high']):.2f}" for axis in "uv" if not unused)
        u, v = ("–", "–") if unused else extents
        share, map_error_mm = percent(float(line["error_share"])), f"{float(line['map_error_mm']):.2f}"
        name = "no square" if unused else in_words(line["segment"])
        body.append((name, f"{int(line['vertices']):,}", line["parameters"] or "–", u, v, map_error_mm, share))
    header = ("", "vertices", "parameters", "u", "v", "map error, mm", "of all error")
    return Table(f"Refinement segments of {character}", (header,), tuple(body))


# The charts that hold refinement segments, with the squares of §3.3 drawn where they lie in texture coordinates.

PANELS = 4  # in a row
EDGE = "#222222"


def chart_of(segment: Segment) -> str:
    """Return the mesh segment in whose chart a refinement segment lies: its name without the number."""
    return segment.name.rpartition("_")[0]


def chart_panels(
    mesh: Mesh, segments: Sequence[Segment], face_colours: UInt8[np.ndarray, "f 3"], width: int = WIDTH // PANELS
) -> list[UInt8[np.ndarray, "h w 3"]]:
    """Return a picture of each chart with refinement segments.

    face_colours: the colour of every mesh face, as on the head above. width: of a picture, pixels.
    """
    charts = dict.fromkeys(map(chart_of, segments))
    return [_panel(mesh, segments, face_colours, chart, width) for chart in charts]


def charts_in_rows(pictures: Sequence[UInt8[np.ndarray, "h w 3"]]) -> list[UInt8[np.ndarray, "h v 3"]]:
    """Join pictures into rows of `PANELS`; the last row is filled up with white."""
    pictures = (
        [*pictures, *(np.full_like(pictures[0], 255) for _ in range(-len(pictures) % PANELS))] if pictures else []
    )
    return [np.concatenate(pictures[k : k + PANELS], axis=1) for k in range(0, len(pictures), PANELS)]


def _panel(mesh, segments, face_colours, chart: str, width: int) -> np.ndarray:
    from matplotlib.figure import Figure

    letter = LETTER * WIDTH
    side, title = width - 10, round(1.4 * letter)
    height = side + title + 6
    figure = Figure((width / DPI, height / DPI), dpi=DPI, facecolor="white")
    axes = figure.add_axes((5 / width, 4 / height, side / width, side / height))
    axes.set_title(chart.replace("_", " "), fontsize=letter * 72 / DPI, pad=4)
    _draw(axes, mesh, [segment for segment in segments if chart_of(segment) == chart], face_colours, chart)
    return as_picture(figure)


def _draw(axes, mesh: Mesh, segments: Sequence[Segment], face_colours: np.ndarray, chart: str) -> None:
    """Draw a chart: its mesh faces in grey or a segment's colour, and the extents of each segment as a rectangle."""
    from matplotlib.collections import PolyCollection
    from matplotlib.patches import Rectangle

    inside = (mesh.segment[mesh.faces] == mesh.segment_names.index(chart)).all(1)
    colours = face_colours[inside] / 255
    axes.add_collection(
        PolyCollection(list(mesh.uv[mesh.faces[inside]]), facecolors=colours, edgecolors=colours, lw=0.2)
    )
    for segment in segments:
        low, high = (end(mesh.uv[segment.vertices], axis=0) for end in (np.min, np.max))
        axes.add_patch(Rectangle(tuple(low), *(high - low), fill=False, edgecolor=EDGE, lw=1.2))
    axes.set(xlim=(-0.02, 1.02), ylim=(-0.02, 1.02), aspect="equal", xticks=(), yticks=())
    for spine in axes.spines.values():
        spine.set_edgecolor(tuple(channel / 255 for channel in UNUSED_COLOUR))
