"""A small rig with a function, a clip and a prop: the bent sheet of `sample_folders`, and a ball that nods with it."""

from dataclasses import dataclass

import numpy as np
from sample_folders import COLUMNS, ROWS, neutral, vertices_at

from data_recipes.controls import Control
from data_recipes.function_rig import FunctionRig
from data_recipes.rig import Clip
from replicate.geometry.mesh import Mesh

FRAMES = 30


@dataclass(frozen=True)
class MovingSheet(FunctionRig):
    def pose_props(self, params):
        corners = 8 * np.float32([[1, 0, 0], [0, 1, 0], [-1, -1, 0], [0, 0, 1], [9, 9, 9]])  # the last is in no face
        faces = np.int32([[0, 1, 3], [1, 2, 3], [2, 0, 3], [0, 2, 1]])
        moved = corners + np.float32([0, 30 - 10 * params[0], 62])
        return [("eye_left", moved, faces, np.full((5, 3), 200, np.uint8))]


def moving_sheet() -> MovingSheet:
    """Return the rig: segments "upper" and "lower lip", whose borders cut through faces, and 30 frames of a clip."""
    row, column = np.divmod(np.arange(ROWS * COLUMNS), COLUMNS)
    first = np.arange(ROWS * COLUMNS)[(row < ROWS - 1) & (column < COLUMNS - 1)]
    a, b, c, d = first, first + 1, first + COLUMNS + 1, first + COLUMNS
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32)
    uv = np.stack([column / (COLUMNS - 1), row / (ROWS - 1)], axis=1).astype(np.float32)
    rest = neutral().astype(np.float32)
    mesh = Mesh(rest, faces, uv, (row + column > 4).astype(np.int32), ("lower lip", "upper"))
    controls = (
        Control("ctl|jaw.open", 0.0, 0.0, 1.0, "mouth"),
        Control("brow_up", -1.0, 0.0, 1.0, "brows"),
        Control("smile", -0.5, 0.0, 1.5, "mouth"),
    )
    t = np.linspace(0, 1, FRAMES)
    values = np.stack([t, np.sin(7 * t), 1.5 * t**2], axis=1).astype(np.float32)
    marks = np.array([2, 27])
    return MovingSheet("sheet", mesh, controls, np.array([2, 12, 27]), marks, ("mouth", "brows"),
                       (Clip("talk", values),), lambda p: vertices_at(p).astype(np.float32))  # fmt: skip
