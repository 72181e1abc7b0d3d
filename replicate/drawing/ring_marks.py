"""Rings around places of a picture that are too small to be seen by themselves."""

import numpy as np
from jaxtyping import Float, UInt8

from replicate.drawing.scene import WHITE, Camera, project

REACH = 0.09  # places that are nearer to a ring's middle than this share of the picture's width share the ring
ROOM = 0.035  # between a ring and the places in it, in the same measure
LINE = 0.012  # the width of a ring's line, and of the white one around it


def ringed(
    picture: UInt8[np.ndarray, "h w 3"],
    places_mm: Float[np.ndarray, "k 3"],
    camera: Camera,
    colour: tuple[int, int, int],
) -> UInt8[np.ndarray, "h w 3"]:
    """Return a picture with rings around some places of its scene; near ones share a ring, and those outside have none.

    What hides a place hides no ring.
    """
    height, width = picture.shape[:2]
    pixels, _ = project(np.asarray(places_mm, float).reshape(-1, 3), camera, width, height)
    pixels = pixels[((pixels > 0) & (pixels < (width, height))).all(1)]
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    picture, line = picture.copy(), max(1.0, LINE * width)
    rings = []
    while len(pixels):
        own = np.linalg.norm(pixels - pixels[0], axis=1) < REACH * width
        middle = pixels[own].mean(0)
        rings.append((middle, np.linalg.norm(pixels[own] - middle, axis=1).max() + ROOM * width))
        pixels = pixels[~own]
    for wide, paint in ((3 * line, WHITE), (line, colour)):  # all of the white first: no ring cuts another one
        for middle, radius in rings:
            away = np.abs(np.hypot(columns - middle[0], rows - middle[1]) - radius)
            picture[away <= wide / 2] = paint
    return picture
