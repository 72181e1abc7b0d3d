"""Draw sheets of the characters: each by itself, its expressions, and all of them side by side."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from data_recipes.catalogue import expression_poses
from data_recipes.rig import Rig, has_function
from replicate.base import paths
from replicate.cli.options import characters
from replicate.drawing.characters import BACKGROUND, character_surfaces, expression_sheet, shown_only
from replicate.drawing.light import PORTRAIT
from replicate.drawing.marks import quad_edges, wireframe
from replicate.drawing.panels import DPI, GAP, MARGIN, TITLE, Words, panel_grid, save_figure
from replicate.drawing.prop_surfaces import prop_surfaces
from replicate.drawing.render import render
from replicate.drawing.scene import Surface, camera_for, frame_surfaces
from replicate.methods import artefacts
from replicate.report.publication import results_folder

if TYPE_CHECKING:
    import matplotlib.figure


def run(options: argparse.Namespace) -> None:
    """Draw the sheets of every character, and one picture of all."""
    folder = results_folder("rigs")
    rigs = [artefacts.rig_of(character) for character in characters(options)]
    for rig in rigs:
        for file in draw_sheets(rig, folder):
            print(f"written to {paths.display_path(file)}")
    print(f"written to {paths.display_path(draw_line_up(rigs, folder))}")


# Twelve expressions that a stranger should recognise without the label.
EXPRESSIONS = (
    "neutral", "joy", "laugh", "surprise", "anger", "sadness", "fear", "disgust", "kiss", "smirk", "shout", "yawn",
)  # fmt: skip
COLUMNS = 6


def draw_sheets(rig: Rig, folder: Path) -> list[Path]:
    """Draw a rig's two sheets into a folder and return the files. rig: any that keeps the Rig contract."""
    poses = expression_poses(rig)
    names = EXPRESSIONS if has_function(rig) else poses
    selection = {name: poses[name] for name in names if name in poses}
    sheets = {
        "sheet": rig_sheet(rig),
        "expressions": expression_sheet(rig, selection, COLUMNS, width=240, height=262),
    }
    for kind, (figure, words) in sheets.items():
        save_figure(figure, folder / f"{rig.name}_{kind}.png", words)
    return [folder / f"{rig.name}_{kind}.png" for kind in sheets]


def draw_line_up(rigs: Sequence, folder: Path) -> Path:
    """Draw the rigs side by side into a folder and return the file."""
    figure, words = line_up(rigs)
    save_figure(figure, folder / "characters.png", words)
    return folder / "characters.png"


# A character's sheet: three views, its edges and the charts of its segments; and all characters side by side.

VIEWS = ("front", "three_quarter", "side")
# The charts' colours in turn: pale enough for lines on them, and distinct to colour-blind readers.
CHART_COLOURS = ("#b5d3ea", "#f6cfa3", "#b9dfc6", "#eec3d2", "#dcd0ea", "#e8e2a8", "#c3dfe6", "#d9c9b8")


def chart_names(rig: Rig) -> list[str]:
    """Return the segments with charts that networks fill: all but teeth."""
    return [name for name in rig.mesh.segment_names if not name.startswith(("tooth", "teeth"))]


def rig_sheet(rig: Rig, width: int = 310, height: int = 340) -> "tuple[matplotlib.figure.Figure, Words]":
    """Draw a rig from three sides and as a wireframe, and below them each segment's chart; return (figure, words).

    rig: any that keeps the Rig contract. width, height: the size of one picture, pixels.
    """
    from matplotlib.figure import Figure
    from matplotlib.textpath import TextPath

    pictures, names = _pictures(rig, width, height), chart_names(rig)
    total_width = 2 * MARGIN + len(pictures) * (width + GAP) - GAP
    columns = max(4, -(-len(names) // 2))
    side = (total_width - 2 * MARGIN + GAP) // columns - GAP
    rows = -(-len(names) // columns)
    total_height = TITLE + height + rows * (TITLE + side) + MARGIN
    figure = Figure((total_width / DPI, total_height / DPI), dpi=DPI, facecolor="white")

    def place(x, y, w, h, title):  # pixels from the upper left corner
        axes = figure.add_axes((x / total_width, 1 - (y + h) / total_height, w / total_width, h / total_height))
        axes.set_axis_off()
        size = min(10, 10 * w / (TextPath((0, 0), title, size=10).get_extents().width * DPI / 72))
        figure.text((x + w / 2) / total_width, 1 - (y - TITLE / 2) / total_height, title, ha="center", va="center",
                    fontsize=size)  # fmt: skip
        return axes

    for column, (title, picture) in enumerate(pictures.items()):
        axes = place(MARGIN + column * (width + GAP), TITLE, width, height, title)
        axes.imshow(picture, interpolation="none", aspect="auto")
    for k, name in enumerate(names):
        row, column = divmod(k, columns)
        top = 2 * TITLE + height + row * (TITLE + side)
        members = rig.mesh.segment == rig.mesh.segment_names.index(name)
        axes = place(MARGIN + column * (side + GAP), top, side, side, f"{name.replace('_', ' ')}  {members.sum():,}")
        _draw_chart(axes, rig.mesh, members, CHART_COLOURS[k % len(CHART_COLOURS)])
    rigid = len(rig.mesh.segment_names) - len(names)
    words = ", ".join(names)
    return figure, Words(
        f"Renders of the character {rig.name} from the front, from three quarters and from the side, then its edges "
        f"over clay; below, the texture charts of its {len(names)} deformable segments: {words}.",
        f"{rig.name}: {len(rig.mesh.neutral):,} vertices, {len(rig.controls)} controls, {len(names)} deformable "
        f"segments with a chart each (its vertices beside its name) and {rigid} rigid ones. "
        f"{shown_only([rig])}".strip(),
    )


def line_up(rigs: Sequence, width: int = 300, height: int = 330) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): the rigs side by side at rest, from the front and from three quarters."""
    rows = [[_portrait(rig, view, width, height) for rig in rigs] for view in ("front", "three_quarter")]
    words = ", ".join(rig.name for rig in rigs)
    return panel_grid(rows, [rig.name for rig in rigs]), Words(
        f"Renders of {len(rigs)} characters at rest, from the front and from three quarters: {words}.",
        f"The characters at rest: {words}. {shown_only(rigs)}".strip(),
    )


def _portrait(rig, view: str, width: int, height: int) -> np.ndarray:
    camera = camera_for(view, rig.mesh.neutral)
    camera = frame_surfaces(camera, character_surfaces(rig, rig.default), width / height)
    surfaces = character_surfaces(rig, rig.default, camera)
    return render(surfaces, camera, width, height, BACKGROUND, PORTRAIT)


def _pictures(rig, width: int, height: int) -> dict[str, np.ndarray]:
    pictures = {view.replace("_", "-"): _portrait(rig, view, width, height) for view in VIEWS}
    mesh, neutral = rig.mesh, rig(rig.default)
    props = rig.pose_props(rig.default)
    clay = [Surface(neutral, mesh.faces), *prop_surfaces([prop for prop in props if prop[0].startswith("eye")])]
    camera = frame_surfaces(camera_for("three_quarter", mesh.neutral), clay[:1], width / height)
    lines = wireframe(neutral, mesh.faces, camera)
    pictures["wireframe"] = render([*clay, lines], camera, width, height, BACKGROUND)
    return pictures


def _draw_chart(axes, mesh, members: np.ndarray, colour: str) -> None:
    """Draw a segment's triangles in its chart, and its edges on top."""
    from matplotlib.collections import LineCollection, PolyCollection

    faces = mesh.faces[members[mesh.faces].all(1)]
    edges = quad_edges(mesh.faces)
    edges = edges[members[edges].all(1)]
    axes.add_collection(PolyCollection(mesh.uv[faces], facecolors=colour, edgecolors=colour, linewidths=0.3))
    thin = float(np.clip(12 / np.sqrt(max(len(edges), 1)), 0.12, 0.4))
    axes.add_collection(LineCollection(mesh.uv[edges], colors="#3a3e46", linewidths=thin))
    axes.set_xlim(-0.01, 1.01)
    axes.set_ylim(-0.01, 1.01)
    axes.set_aspect("equal")
