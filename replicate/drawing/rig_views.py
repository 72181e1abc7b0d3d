"""A coloured rig from several sides and into its open mouth, with a legend (Figs 7 and 8)."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float32, Int, UInt8
from scipy.ndimage import distance_transform_edt

from data_recipes.rig import Rig, has_function
from replicate.base.tables import Column, read_csv, write_csv
from replicate.drawing.face_sheet import LETTER, WIDE, WIDTH, Cell, cell_width, face_sheet
from replicate.drawing.light import EVEN, trace
from replicate.drawing.panels import DPI, as_picture
from replicate.drawing.prop_surfaces import prop_surfaces
from replicate.drawing.render import render
from replicate.drawing.scene import Camera, Surface, camera_for, frame_surfaces

if TYPE_CHECKING:
    import matplotlib.figure

# Colours that many readers can tell apart, the most different first, after Kelly (1965): his list without white, black
# and grey, and with turquoise and magenta for two of his yellows, which shading makes look like the first.
DISTINCT = (
    (243, 195, 0), (135, 86, 146), (243, 132, 0), (161, 202, 241), (190, 0, 50), (194, 178, 128), (0, 136, 86),
    (230, 143, 172), (0, 103, 165), (249, 147, 121), (96, 78, 151), (0, 160, 176), (179, 68, 108), (240, 60, 190),
    (136, 45, 23), (141, 182, 0), (101, 69, 34), (226, 88, 34), (43, 61, 38),
)  # fmt: skip
UNUSED_COLOUR = (205, 205, 205)
VIEWS = {"front": "front", "three_quarter": "three-quarter", "mouth": "into the mouth"}
# Shares of their ranges at which controls show the inside of a mouth, by the beginnings of their names.
OPEN = {"jaw_open": 0.8, "jaw_drop": 0.3, "upper_lip_raise": 0.9, "lower_lip_depress": 0.9}
INSIDE = ("tooth", "teeth", "gum")  # beginnings of the segments that the camera into the mouth frames
EYE = "eye"  # beginning of the props that fill the sockets
TALL = 1.05  # a view's height over its width
LABEL_PT, LABEL_ROOM = 13, 0.022  # a label's letters; how far from a part's edge it stands at least, in picture widths


def open_mouth(rig: Rig) -> Float32[np.ndarray, " m"]:
    """Return the parameters of a wide open mouth; the neutral pose for a rig without controls of such names.

    For a rig that is known by its samples alone, return the sample nearest to it.
    """
    shares = (
        next((share for start, share in OPEN.items() if control.name.startswith(start)), 0.0)
        for control in rig.controls
    )
    ideal = rig.default + np.fromiter(shares, np.float32) * (rig.upper - rig.default)
    if has_function(rig) or (ideal == rig.default).all():
        return ideal
    known = np.asarray(rig.known_poses.frame_params)
    away = np.square((known - ideal) / (rig.upper - rig.lower)).sum(axis=1)
    return known[np.argmin(away)].astype(np.float32)


def coloured_views(
    rig: Rig,
    colours: UInt8[np.ndarray, "f 3"],
    below: Sequence[UInt8[np.ndarray, "_ w 3"]],
    across: int | None = None,
    labels: Mapping[int, str] | None = None,
    part: Int[np.ndarray, " f"] | None = None,
) -> "matplotlib.figure.Figure":
    """Return a figure: the rig with an open mouth from each of `VIEWS`, and pictures that fill the width below them.

    rig: drawn without props but its eyeballs.
    colours: one for each face.
    below: the pictures.
    across: the width of a view, pixels; None to fill the sheet.
    labels: words that stand on parts of the mesh, by the part's number; a part that shows little of itself has none.
    part: the part that each face belongs to, if there are labels.
    """
    from matplotlib.patheffects import Normal, Stroke

    params, mesh = open_mouth(rig), rig.mesh
    posed = rig(params)
    surfaces = [Surface(posed, mesh.faces, colours)]
    surfaces += prop_surfaces(prop for prop in rig.pose_props(params) if prop[0].startswith(EYE))
    inside = [k for k, name in enumerate(mesh.segment_names) if name.startswith(INSIDE)]
    contents = posed[np.isin(mesh.segment, inside)]
    width = across or cell_width(len(VIEWS))
    height, cells, places = round(TALL * width), [], []
    for name, title in VIEWS.items():
        camera = camera_for(name, mesh.neutral)
        if name == "mouth" and len(contents):
            middle, extent = (contents.min(0) + contents.max(0)) / 2, np.ptp(contents, axis=0)
            tall = 1.35 * max(float(extent[1]), float(extent[0]) * height / width)
            camera = replace(camera, focus=tuple(map(float, middle)), height_mm=tall)
        elif name != "mouth":
            camera = frame_surfaces(camera, surfaces, width / height)
        cells.append(Cell(title, (render(surfaces, camera, width, height, studio=EVEN),)))
        places.append(_label_places(surfaces, part, camera, width, height) if labels else {})
    figure = face_sheet(cells, len(cells), below=below)
    halo = [Stroke(linewidth=2.5, foreground="white"), Normal()]
    for axes, there in zip(figure.axes, places, strict=False):
        for x, y, text in _without_collisions([(*there[k], labels[k]) for k in there if k in labels], width):
            axes.text(x, y, text, ha="center", va="center", fontsize=LABEL_PT, path_effects=halo)
    return figure


def _without_collisions(labels: Sequence[tuple[float, float, str]], width: int) -> list[tuple[float, float, str]]:
    """Return the labels (x, y, text) that lie within a picture's width and don't cover earlier ones."""
    letter = LABEL_PT * DPI / 72
    kept: list[tuple[float, float, str]] = []
    for x, y, text in labels:
        half = WIDE * letter * len(text) / 2
        is_free = all(
            abs(y - there) > letter or abs(x - across) > half + WIDE * letter * len(other) / 2
            for across, there, other in kept
        )
        if half < x < width - half and is_free:
            kept.append((x, y, text))
    return kept


def _label_places(
    surfaces: Sequence[Surface], part: Int[np.ndarray, " f"], camera: Camera, width: int, height: int
) -> dict[int, tuple[float, float]]:
    """Return the pixel (x, y) of each part that is farthest from what isn't the part, those with most room first.

    surfaces: the mesh, whose faces belong to `part`, and what hides it.
    """
    mesh, *others = surfaces
    codes = np.stack([part + 1, 0 * part, 0 * part], 1).astype(np.uint8)
    scene = [replace(mesh, colours=codes, lit=False), *(replace(one, colours=(0, 0, 0), paint=None) for one in others)]
    seen = trace(scene, camera, width, height, (0, 0, 0))[..., 0].astype(int) - 1
    found = []
    for k in np.unique(seen[seen >= 0]):
        room = distance_transform_edt(np.pad(seen == k, 1))[1:-1, 1:-1]
        y, x = np.unravel_index(room.argmax(), room.shape)
        if room[y, x] > LABEL_ROOM * width:
            found.append((float(room[y, x]), int(k), (float(x), float(y))))
    return {k: place for _, k, place in sorted(found, reverse=True)}


def legend_panel(entries: Sequence[tuple], heading: str = "", width: int = WIDTH) -> UInt8[np.ndarray, "h w 3"]:
    """Return a picture that lists (text, colours) pairs below a heading, column by column; colours share a square.

    It has as many columns as its longest text leaves room for, and the letters of a face sheet.
    """
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    letter = LETTER * WIDTH
    line, square = round(1.3 * letter), round(0.9 * letter)
    longest = max((len(text) for text, _ in entries), default=0)
    columns = max(1, int(width // (WIDE * letter * longest + 2 * letter)))
    lines = -(-len(entries) // columns)
    columns = max(1, -(-len(entries) // max(1, lines)))
    height = line * (lines + bool(heading)) + 4
    figure = Figure((width / DPI, height / DPI), dpi=DPI, facecolor="white")
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, width), ylim=(height, 0))
    axes.set_axis_off()
    style = {"va": "center", "fontsize": letter * 72 / DPI}
    if heading:
        axes.text(4, line / 2, heading, **style)
    for k, (text, colours) in enumerate(entries):
        x, y = 4 + (k // lines) * width / columns, line * (k % lines + bool(heading))
        for part, colour in enumerate(colours):
            wide = square / len(colours)
            corner = x + part * wide, y + (line - square) / 2
            axes.add_patch(Rectangle(corner, wide, square, color=[c / 255 for c in colour], linewidth=0))
        if colours:
            edge = Rectangle((x, y + (line - square) / 2), square, square, fill=False, edgecolor="0.5", linewidth=0.8)
            axes.add_patch(edge)
        axes.text(x + 1.3 * letter, y + line / 2, text, **style)
    return as_picture(figure)


def hexadecimal(colour: Sequence[int]) -> str:
    """Return a colour as "#rrggbb"."""
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
