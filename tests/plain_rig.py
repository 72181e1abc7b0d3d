"""A base for stand-in rigs: all that the Rig contract asks for, and all of it empty."""

import numpy as np


class PlainRig:
    name, mesh, controls = "plain", None, ()
    lower = default = upper = np.zeros(0, np.float32)
    landmarks = control_points = face_marks = np.zeros(0, np.int32)
    landmark_names = control_point_names = control_point_regions = face_mark_regions = nodes = ()
    clips = paint = None

    def __call__(self, params):
        return np.zeros((len(params), 0, 3), np.float32)

    def pose_props(self, params):
        return []
