"""A character in several poses, in the colours of skin, teeth and mouth: what a reader sees first."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import UInt8

from replicate.evaluation.pose import colour_in_bytes
from replicate.figures.panels import Words, panel_grid
from replicate.figures.render import render
from replicate.figures.scene import CLAY, Surface, camera_for
from replicate.mesh import Mesh

SKIN = (226, 178, 148)
# By the beginning of a segment's name; what begins otherwise is skin.
COLOURS = {"tooth": (245, 242, 230), "gum": (205, 105, 105), "tongue": (214, 110, 112), "mouth": (150, 60, 60)}
ROOM = 1.07  # a stretched head is taller than one at rest
BACKGROUND = (231, 235, 238)


def segment_colours(mesh: Mesh, skin: tuple[int, int, int] = SKIN) -> UInt8[np.ndarray, "f 3"]:
    """Return each face's colour by what it is part of."""
    named = [next((c for start, c in COLOURS.items() if name.startswith(start)), skin) for name in mesh.segment_names]
    return np.array(named, np.uint8)[mesh.face_segment]


def expression_sheet(
    rig,
    poses: Mapping[str, np.ndarray],
    columns: int = 4,
    camera: str = "front",
    clay: bool = False,
    width: int = 300,
    height: int = 320,
    renderer=None,
):
    """Return (figure, words): a rig in several poses, titled, row by row, with its props where it has any.

    rig: any that keeps the Rig contract. poses: title → parameters (m,). clay: leave out colours, as in the paper.
    """
    mesh = rig.mesh
    view = camera_for(camera, mesh.neutral)
    view = replace(view, height_mm=ROOM * view.height_mm)
    colours = CLAY if clay else segment_colours(mesh)
    pictures = []
    for params in poses.values():
        surfaces = [Surface(rig(params), mesh.faces, colours)]
        if hasattr(rig, "pose_props"):
            for _, vertices, faces, colour in rig.pose_props(params):
                surfaces.append(Surface(vertices, faces, colour_in_bytes(colour)))
        pictures.append(render(surfaces, view, width, height, BACKGROUND, renderer))
    blank = np.full((height, width, 3), 255, np.uint8)
    pictures += [blank] * (-len(pictures) % columns)
    titles = [*poses, *[""] * (len(pictures) - len(poses))]
    rows = [pictures[k : k + columns] for k in range(0, len(pictures), columns)]
    grid = [titles[k : k + columns] for k in range(0, len(titles), columns)]
    figure = panel_grid(rows, grid)
    listed = ", ".join(poses)
    return figure, Words(
        f"Renders of the character {rig.name} in {len(poses)} poses: {listed}.",
        f"{rig.name}: {len(mesh.neutral):,} vertices, {len(rig.controls)} controls. Poses: {listed}. Hair, brows and "
        "eyeballs are for display only; no method approximates them.",
    )
