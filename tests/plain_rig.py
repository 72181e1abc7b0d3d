"""A base for stand-in rigs: what the Rig contract asks for beside a mesh, controls and poses, all of it empty."""

import numpy as np


class PlainRig:
    name = "plain"
    lower = default = upper = np.zeros(0, np.float32)
    landmarks = control_points = np.zeros(0, np.int32)
    landmark_names = control_point_regions = nodes = ()
    clips = paint = None

    def pose_props(self, params):
        return []
