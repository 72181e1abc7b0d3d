"""A rig that a user could bring: four vertices, two controls, a function of plain numpy."""

import numpy as np

from data_recipes.controls import Control
from data_recipes.function_rig import FunctionRig
from replicate.geometry.mesh import Mesh

MESH = Mesh(
    neutral=np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 10]], np.float32),
    faces=np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.int32),
    uv=np.array([[0, 0], [1, 0], [0, 1], [0.5, 0.5]], np.float32),
    segment=np.zeros(4, np.int32),
    segment_names=("all",),
)


CONTROLS = (Control("lift", 0.0, 0.0, 1.0, "all"), Control("turn", -1.0, 0.0, 1.0, "all"))


def lift(p):
    return MESH.neutral + p[:, :1, None] * np.array([0, 5.0, 0]) + p[:, 1:, None] * np.array([0, 0, 2.0])


def foreign(**changes) -> FunctionRig:
    arguments = {"name": "box", "mesh": MESH, "controls": CONTROLS, "landmarks": np.array([0, 3]), "function": lift,
                 "control_points": np.array([1]), "control_point_regions": ("all",), "clips": None}  # fmt: skip
    return FunctionRig(**(arguments | changes))
