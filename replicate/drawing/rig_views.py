"""A rig in colours of its own, from several sides and into its open mouth, with a legend (Figs 7 and 8)."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float32, UInt8

from data_recipes.rig import Rig
from replicate.drawing.panels import DPI, panel_grid
from replicate.drawing.prop_surfaces import prop_surfaces
from replicate.drawing.render import render
from replicate.drawing.scene import Surface, camera_for
from replicate.engine.tidy_files import Column, read_csv, write_csv

if TYPE_CHECKING:
    import matplotlib.figure

# Colours that are distinct to many readers, most different first, after Kelly (1965): his list less white, black, grey,
# and with turquoise and magenta for his two further yellows, which shading makes one with the first.
DISTINCT = (
    (243, 195, 0), (135, 86, 146), (243, 132, 0), (161, 202, 241), (190, 0, 50), (194, 178, 128), (0, 136, 86),
    (230, 143, 172), (0, 103, 165), (249, 147, 121), (96, 78, 151), (0, 160, 176), (179, 68, 108), (240, 60, 190),
    (136, 45, 23), (141, 182, 0), (101, 69, 34), (226, 88, 34), (43, 61, 38),
)  # fmt: skip
UNUSED_COLOUR = (205, 205, 205)
VIEWS = {"front": "front", "three_quarter": "three-quarter", "mouth": "into the mouth"}
# Shares of their ranges at which controls show the inside of a mouth, by the beginnings of their names.
OPEN = {"jaw_open": 0.8, "jaw_drop": 0.3, "upper_lip_raise": 0.9, "lower_lip_depress": 0.9}
INSIDE = ("tooth", "teeth", "gum")  # how the segments begin that the camera into the mouth frames
EYE = "eye"  # how the props begin that fill the sockets; without them one looks into an empty head
ROOM = 1.12  # an open mouth needs more height than a closed one
LINE = 15  # pixels a line of the legend


def open_mouth(rig: Rig) -> Float32[np.ndarray, " m"]:
    """Return the parameters of a wide open mouth; the neutral pose for a rig without controls of such names."""
    shares = (
        next((share for start, share in OPEN.items() if control.name.startswith(start)), 0.0)
        for control in rig.controls
    )
    return rig.default + np.fromiter(shares, np.float32) * (rig.upper - rig.default)


def coloured_views(
    rig: Rig,
    colours: UInt8[np.ndarray, "f 3"],
    legend: Sequence[tuple],
    width: int = 256,
    height: int = 330,
    renderer: str | None = None,
    below: Sequence[UInt8[np.ndarray, "h w 3"]] = (),
) -> "matplotlib.figure.Figure":
    """Return a figure: the rig with an open mouth from each of `VIEWS`, then the legend.

    colours: one for each face. legend: (text, colours) pairs; of props only the eyeballs are drawn. below: as many
    pictures of the same size, for a second row.
    """
    params, mesh = open_mouth(rig), rig.mesh
    posed = rig(params)
    surfaces = [Surface(posed, mesh.faces, colours)]
    surfaces += prop_surfaces(prop for prop in rig.pose_props(params) if prop[0].startswith(EYE))
    inside = [k for k, name in enumerate(mesh.segment_names) if name.startswith(INSIDE)]
    contents = posed[np.isin(mesh.segment, inside)]
    pictures = []
    for name in VIEWS:
        camera = camera_for(name, mesh.neutral)
        if name == "mouth" and len(contents):
            middle, extent = (contents.min(0) + contents.max(0)) / 2, np.ptp(contents, axis=0)
            tall = 1.35 * max(float(extent[1]), float(extent[0]) * height / width)
            camera = replace(camera, focus=tuple(map(float, middle)), height_mm=tall)
        else:
            camera = replace(camera, height_mm=ROOM * camera.height_mm)
        pictures.append(render(surfaces, camera, width, height, renderer=renderer))
    key = legend_panel(legend, width, height)
    titles = [*VIEWS.values(), ""]
    if not below:
        return panel_grid([[*pictures, key]], titles)
    return panel_grid([[*pictures, key], below], [titles, [""] * len(titles)])


def legend_panel(entries: Sequence[tuple], width: int, height: int) -> UInt8[np.ndarray, "h w 3"]:
    """Return a picture that lists (text, colours) pairs, line by line; the colours share a square."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    figure = Figure((width / DPI, height / DPI), dpi=DPI, facecolor="white")
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, width), ylim=(height, 0))
    axes.set_axis_off()
    line = min(LINE, height // max(1, len(entries)))
    top = (height - line * len(entries)) / 2
    for k, (text, colours) in enumerate(entries):
        y = top + line * k
        for part, colour in enumerate(colours):
            wide = (line - 4) / len(colours)
            axes.add_patch(Rectangle((8 + part * wide, y + 2), wide, line - 4, color=[c / 255 for c in colour]))
        axes.text(8 + line + 4, y + line / 2, text, va="center", fontsize=0.53 * line)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def hexadecimal(colour: Sequence[int]) -> str:
    """Return a colour as CSV files have it."""
    return "#" + "".join(f"{int(channel):02x}" for channel in colour)


def write_lines(file: Path, header: Sequence[str], lines: Iterable[Sequence]) -> None:
    """Write the numbers behind a figure as CSV; the file appears whole or not at all."""
    write_csv(file, _columns(header), lines)


def read_lines(file: Path, header: Sequence[str]) -> list[dict[str, str]]:
    """Read what `write_lines` wrote: a line as column → cell. Raises InputError, naming the file, for anything else.

    The file is named after the target that writes it: figure07_teen.csv, lbs_teen.csv.
    """
    target = file.stem.partition("_")[0]
    missing = f"there is no such file; `make {target}` writes it."
    return read_csv(file, _columns(header), (), missing).to_dict("records")


def _columns(header: Sequence[str]) -> list[Column]:
    return [Column(name, optional=True) for name in header]
