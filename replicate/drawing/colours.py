"""Colours as pictures have them: red, green and blue from 0 to 255; and how far apart they look."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

# Rows: red, green and blue of sRGB in the CIE's X, Y and Z, those of white being 1.
_TO_XYZ = np.array([[0.4339, 0.2126, 0.0177], [0.3762, 0.7152, 0.1095], [0.1899, 0.0722, 0.8728]])


def colour_in_bytes(colour: Sequence[float]) -> tuple[int, int, int]:
    """Return a colour from 0 to 255; one whose parts are at most 1 is taken to be from 0 to 1."""
    scale = 255 if max(colour) <= 1 else 1
    return tuple(round(scale * float(channel)) for channel in colour)


def perceived(colours: Sequence) -> Float[np.ndarray, "*s 3"]:
    """Return colours (..., 3) from 0 to 255 in the CIE's L*a*b*, where distances are those that the eye sees.

    About 2 is just noticeable; below 30 or so, shading makes one colour look like the other.
    """
    part = np.asarray(colours, float) / 255
    linear = np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4)
    root = linear @ _TO_XYZ
    root = np.where(root > 0.008856, np.cbrt(root), 7.787 * root + 16 / 116)
    x, y, z = np.moveaxis(root, -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], -1)
