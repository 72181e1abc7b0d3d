"""A rig that is known by its samples, to look at: its segments in colours, and a few of the poses that are known."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from data_recipes.catalogue import expression_poses
from data_recipes.rig import Rig
from replicate.drawing.face_sheet import Cell, cell_width, face_sheet
from replicate.drawing.panels import Words
from replicate.drawing.render import render
from replicate.drawing.rig_views import DISTINCT
from replicate.drawing.scene import Surface, camera_for

if TYPE_CHECKING:
    import matplotlib.figure

COLUMNS, TALL = 4, 1.2  # pictures in a row; a picture's height over its width
SHOWN = 6  # poses, those that differ most
ROOM = 1.15  # around a neutral head, for those that stretch


def known_faces(rig: Rig, renderer: str | None = None) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): the segments on the neutral face, then that face and the poses that differ most."""
    mesh, width = rig.mesh, cell_width(COLUMNS)
    colours = np.array([DISTINCT[k % len(DISTINCT)] for k in range(len(mesh.segment_names))], np.uint8)
    segments = Surface(mesh.neutral, mesh.faces, colours[mesh.segment[mesh.faces].max(axis=1)])
    poses = dict(list(expression_poses(rig).items())[: SHOWN + 1])
    surfaces = {"segments": segments} | {name: Surface(rig(pose), mesh.faces) for name, pose in poses.items()}
    camera = camera_for("three_quarter", mesh.neutral)
    camera = replace(camera, height_mm=ROOM * camera.height_mm)
    cells = [
        Cell(name.replace("_", " "), (render([surface], camera, width, round(TALL * width), renderer=renderer),))
        for name, surface in surfaces.items()
    ]
    return face_sheet(cells, COLUMNS), Words(
        f"Clay renders of {rig.name}: {len(mesh.segment_names)} segments in colours, then {len(poses)} known poses.",
        f"What is known of {rig.name}: its segments, the neutral face, and poses that are far apart. A face that is "
        "torn, turned or of the wrong size is seen here before anything is trained.",
    )
