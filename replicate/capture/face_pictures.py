"""Pictures of faces in a performance: in clay, with one camera for all frames."""

import numpy as np
from jaxtyping import Float, UInt8

from data_recipes.rig import Rig
from replicate.drawing.prop_surfaces import prop_surfaces
from replicate.drawing.render import render
from replicate.drawing.scene import Camera, Surface, camera_for, frame_surfaces

MARGIN = 0.06  # of a picture's height around the head at rest, since it moves


def head_camera(rig: Rig, aspect: float) -> Camera:
    """Return the camera in front of a head that has all of it in a picture of this width over height."""
    front = camera_for("front", rig.mesh.neutral)
    shown = [Surface(rig.mesh.neutral, rig.mesh.faces), *prop_surfaces(rig.pose_props(rig.default))]
    return frame_surfaces(front, shown, aspect, MARGIN)


def face_picture(
    face: Rig,
    params: Float[np.ndarray, " m"],
    camera: Camera,
    width: int,
    height: int,
    renderer: str | None = None,
    marks: Surface | None = None,
) -> UInt8[np.ndarray, "h w 3"]:
    """Return a picture of a face in a pose. marks: a surface that is drawn into it."""
    surfaces = [Surface(face(params), face.mesh.faces), *prop_surfaces(face.pose_props(params), camera)]
    return render([*surfaces, *([marks] if marks else [])], camera, width, height, renderer=renderer)
