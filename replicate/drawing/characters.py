"""A character in several poses, in the colours of skin, teeth and mouth."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, UInt8

from data_recipes.rig import Rig
from replicate.drawing.light import PORTRAIT
from replicate.drawing.panels import Words, panel_grid
from replicate.drawing.prop_surfaces import prop_surfaces
from replicate.drawing.render import render
from replicate.drawing.scene import Camera, Surface, camera_for, frame_surfaces
from replicate.geometry.mesh import Mesh

if TYPE_CHECKING:
    import matplotlib.figure

SKIN = (226, 178, 148)
# By the beginning of a segment's name; all others are skin.
COLOURS = {
    "tooth": (245, 242, 230),
    "teeth": (245, 242, 230),
    "gum": (205, 105, 105),
    "tongue": (214, 110, 112),
    "mouth": (150, 60, 60),
}
BACKGROUND = (236, 239, 243)


def colours_by_segment(mesh: Mesh, skin: tuple[int, int, int] = SKIN) -> UInt8[np.ndarray, "s 3"]:
    """Return each segment's colour, by its name."""
    colours = [next((c for start, c in COLOURS.items() if name.startswith(start)), skin) for name in mesh.segment_names]
    return np.array(colours, np.uint8)


def segment_colours(mesh: Mesh, skin: tuple[int, int, int] = SKIN) -> UInt8[np.ndarray, "f 3"]:
    """Return each face's colour, by the name of its segment."""
    return colours_by_segment(mesh, skin)[mesh.face_segment]


def character_surfaces(rig: Rig, params: Float[np.ndarray, " m"], camera: Camera | None = None) -> list[Surface]:
    """Return a rig in a pose with its props, painted or, where it has no paint, coloured by segment.

    camera: gives the eyes catchlights, as in `prop_surfaces`.
    """
    colours = {"colours": segment_colours(rig.mesh)} if rig.paint is None else {"paint": rig.paint}
    return [Surface(rig(params), rig.mesh.faces, **colours), *prop_surfaces(rig.pose_props(params), camera)]


# What is for display only, by the beginnings of the names of props.
SHOWN_ONLY = {"hair": "hair", "brow": "brows", "horn": "horns", "glasses": "glasses", "eye": "eyeballs"}


def shown_only(rigs: Sequence[Rig]) -> str:
    """Return what of some rigs is for display only, as a sentence; "" where nothing is."""
    names = [prop[0] for rig in rigs for prop in rig.pose_props(rig.default)]
    found = ["paint"] if any(rig.paint is not None for rig in rigs) else []
    found += [word for start, word in SHOWN_ONLY.items() if any(name.startswith(start) for name in names)]
    if not found:
        return ""
    words = " and ".join(filter(None, [", ".join(found[:-1]), found[-1]]))
    are, them = ("is", "it") if found == ["paint"] else ("are", "them")
    return f"{words[0].upper()}{words[1:]} {are} for display only; no method approximates {them}."


def expression_sheet(
    rig: Rig,
    poses: Mapping[str, np.ndarray],
    columns: int = 4,
    camera: str = "front",
    width: int = 300,
    height: int = 320,
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): a rig in several poses, row by row, each under its title and with the rig's props.

    rig: the character's.
    poses: title → parameters (m,).
    columns: pictures in a row.
    camera: one of `CAMERAS`.
    width, height: of a picture, pixels.
    """
    mesh = rig.mesh
    view = camera_for(camera, mesh.neutral)
    posed = [surface for params in poses.values() for surface in character_surfaces(rig, params)]
    view = frame_surfaces(view, posed, width / height)  # a stretched head is taller than one at rest
    pictures = [
        render(character_surfaces(rig, params, view), view, width, height, BACKGROUND, PORTRAIT)
        for params in poses.values()
    ]
    blank = np.full((height, width, 3), 255, np.uint8)
    pictures += [blank] * (-len(pictures) % columns)
    titles = [*poses, *[""] * (len(pictures) - len(poses))]
    rows = [pictures[k : k + columns] for k in range(0, len(pictures), columns)]
    grid = [titles[k : k + columns] for k in range(0, len(titles), columns)]
    figure = panel_grid(rows, grid)
    names = ", ".join(poses)
    return figure, Words(
        f"Renders of the character {rig.name} in {len(poses)} poses: {names}.",
        f"{rig.name}: {len(mesh.neutral):,} vertices, {len(rig.controls)} controls. Poses: {names}. "
        f"{shown_only([rig])}".strip(),
    )
