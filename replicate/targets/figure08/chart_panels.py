"""The charts that hold refinement segments, with the squares of §3.3 drawn where they lie in texture coordinates."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import UInt8

from replicate.approximation.segments import Segment
from replicate.drawing.face_sheet import LETTER, WIDTH
from replicate.drawing.panels import DPI
from replicate.drawing.rig_views import UNUSED_COLOUR
from replicate.geometry.mesh import Mesh

PANELS = 4  # in a row
EDGE = "#222222"


def chart_of(segment: Segment) -> str:
    """Return the mesh segment in whose chart a refinement segment lies: its name without the number."""
    return segment.name.rpartition("_")[0]


def chart_panels(
    mesh: Mesh, segments: Sequence[Segment], face_colours: UInt8[np.ndarray, "f 3"], width: int = WIDTH // PANELS
) -> list[UInt8[np.ndarray, "h w 3"]]:
    """Return a picture of so many pixels' width of each chart with refinement segments.

    face_colours: of every mesh face, as on the head above them.
    """
    charts = dict.fromkeys(map(chart_of, segments))
    return [_panel(mesh, segments, face_colours, chart, width) for chart in charts]


def charts_in_rows(pictures: Sequence[UInt8[np.ndarray, "h w 3"]]) -> list[UInt8[np.ndarray, "h v 3"]]:
    """Return `PANELS` pictures side by side as one, row by row; the last is filled up with white."""
    pictures = (
        [*pictures, *(np.full_like(pictures[0], 255) for _ in range(-len(pictures) % PANELS))] if pictures else []
    )
    return [np.concatenate(pictures[k : k + PANELS], axis=1) for k in range(0, len(pictures), PANELS)]


def _panel(mesh, segments, face_colours, chart: str, width: int) -> np.ndarray:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    letter = LETTER * WIDTH
    side, title = width - 10, round(1.4 * letter)
    height = side + title + 6
    figure = Figure((width / DPI, height / DPI), dpi=DPI, facecolor="white")
    axes = figure.add_axes((5 / width, 4 / height, side / width, side / height))
    axes.set_title(chart.replace("_", " "), fontsize=letter * 72 / DPI, pad=4)
    _draw(axes, mesh, [segment for segment in segments if chart_of(segment) == chart], face_colours, chart)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _draw(axes, mesh: Mesh, segments: Sequence[Segment], face_colours: np.ndarray, chart: str) -> None:
    """Draw a chart: its mesh faces in grey or a segment's colour, and the extents of each segment as a rectangle."""
    from matplotlib.collections import PolyCollection
    from matplotlib.patches import Rectangle

    inside = (mesh.segment[mesh.faces] == mesh.segment_names.index(chart)).all(1)
    colours = face_colours[inside] / 255
    axes.add_collection(PolyCollection(mesh.uv[mesh.faces[inside]], facecolors=colours, edgecolors=colours, lw=0.2))
    for segment in segments:
        low, high = (end(mesh.uv[segment.vertices], axis=0) for end in (np.min, np.max))
        axes.add_patch(Rectangle(tuple(low), *(high - low), fill=False, edgecolor=EDGE, lw=1.2))
    axes.set(xlim=(-0.02, 1.02), ylim=(-0.02, 1.02), aspect="equal", xticks=(), yticks=())
    for spine in axes.spines.values():
        spine.set_edgecolor(tuple(channel / 255 for channel in UNUSED_COLOUR))
