"""Two pictures of one face as one: the left of the face's middle from the first, the right of it from the second."""

import numpy as np
from jaxtyping import Float, Int, UInt8

from replicate.drawing.scene import WHITE, Camera, faces_in_view, project

MIDDLE = 0.03  # how far from the plane of symmetry, as a share of the head's width, a face of the mesh is in the middle
SEAM = 0.006  # the width of the white line between the halves, as a share of the picture's width


def middle_line(
    neutral: Float[np.ndarray, "n 3"],
    vertices: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "f 3"],
    camera: Camera,
    width: int,
    height: int,
) -> Float[np.ndarray, " h"]:
    """Return where the middle of a posed face is in each row of a picture, in pixels from its left edge.

    It is the straight line that fits best where the neutral face has x = 0, so it tilts with the head. A picture that
    shows nothing of it is halved upright.
    """
    centres = neutral[faces].mean(1)
    near = np.abs(centres[:, 0]) < MIDDLE * np.ptp(neutral[:, 0])
    shown = near & faces_in_view(vertices, faces, camera)
    rows = np.arange(height) + 0.5
    if shown.sum() < 2:
        return np.full(height, width / 2)
    pixels, _ = project(vertices[faces[shown]].mean(1).astype(float), camera, width, height)
    system = np.stack([pixels[:, 1], np.ones(len(pixels))], 1)
    slope, start = np.linalg.lstsq(system, pixels[:, 0], rcond=None)[0]
    return start + slope * rows


def split_face(
    left: UInt8[np.ndarray, "h w 3"], right: UInt8[np.ndarray, "h w 3"], line: Float[np.ndarray, " h"]
) -> UInt8[np.ndarray, "h w 3"]:
    """Return the left picture up to a line (h,), in pixels, and the right one beyond it, with a white seam between."""
    across = np.arange(left.shape[1]) + 0.5 - line[:, None]
    picture = np.where((across > 0)[..., None], right, left)
    picture[np.abs(across) < max(1.0, SEAM * left.shape[1] / 2)] = WHITE
    return picture
