"""Errors as colours on the mesh, never shaded, with one scale for all panels (Fig. 10)."""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int, UInt8

from replicate.approximation.metrics import normal_error
from replicate.drawing.scene import WHITE, Camera, Surface, faces_in_view, project

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.colorbar
    import matplotlib.figure


COLOUR_MAP = "viridis"  # perceptually uniform, and in order for readers who see fewer colours
NO_NORMAL = (200, 200, 200)  # faces that Eq. 11 leaves out
ROOT = 0.5  # the power for normal errors: one degree is visible, and 12° and 22° differ
NORMAL_TICKS_DEG = (0, 1, 3, 6, 12, 20, 30, 45, 60, 90, 180)


def error_colours(errors: Float[np.ndarray, " f"], limit: float, power: float = 1.0) -> UInt8[np.ndarray, "f 3"]:
    """Return each face's colour for an error from 0 to `limit`; larger ones get the last colour, NaN grey.

    power: of the error's share of the limit, by which the colour is chosen.
    """
    from matplotlib import colormaps

    share = np.clip(np.nan_to_num(errors) / limit, 0.0, 1.0) ** power
    colours = np.rint(colormaps[COLOUR_MAP](share)[:, :3] * 255).astype(np.uint8)
    colours[np.isnan(errors)] = NO_NORMAL
    return colours


def normal_heat(
    predicted: Float[np.ndarray, "n 3"],
    truth: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "f 3"],
    limit_deg: float,
) -> Surface:
    """Return the predicted surface, each face coloured by its normal's error (Eq. 11) up to `limit_deg`."""
    colours = error_colours(normal_error(predicted, truth, faces), limit_deg, ROOT)
    return Surface(predicted, faces, colours, lit=False)


def normal_bar(
    figure: "matplotlib.figure.Figure", axes: "matplotlib.axes.Axes", limit_deg: float, orientation: str = "vertical"
) -> None:
    """Draw the bar of `normal_heat` in `axes`; orientation: "vertical" or "horizontal"."""
    bar = colour_bar(figure, axes, limit_deg, "normal angle error, degrees", ROOT, orientation)
    bar.set_ticks([tick for tick in NORMAL_TICKS_DEG if tick <= limit_deg])


def colour_bar(
    figure: "matplotlib.figure.Figure",
    axes: "matplotlib.axes.Axes",
    limit: float,
    label: str,
    power: float = 1.0,
    orientation: str = "vertical",
) -> "matplotlib.colorbar.Colorbar":
    """Draw the bar of `error_colours` in `axes`, with an arrow at the end for larger errors.

    figure, axes: where it is drawn.
    limit, power: as for `error_colours`.
    label: with the unit.
    orientation: "vertical" or "horizontal".
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import PowerNorm

    scale = ScalarMappable(PowerNorm(power, 0, limit), COLOUR_MAP)
    bar = figure.colorbar(scale, cax=axes, extend="max", orientation=orientation)
    bar.set_label(label)
    bar.outline.set_linewidth(0.5)
    return bar


# Two pictures of one face as one: the left half from the first, the right half from the second.

MIDDLE = 0.03  # triangles so near to the plane of symmetry, as a share of the head's width, are in the middle
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

    It is the straight line that best fits the triangles about x = 0 of the neutral face, so it tilts with the head. It
    is vertical in a picture that shows none of them.

    neutral, vertices: at rest and posed, mm.
    faces: the mesh's triangles.
    camera: of the picture.
    width, height: of the picture, pixels.
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
    """Return the left picture up to a line, in pixels for each row, and the right one beyond it, with a white seam."""
    across = np.arange(left.shape[1]) + 0.5 - line[:, None]
    picture = np.where((across > 0)[..., None], right, left)
    picture[np.abs(across) < max(1.0, SEAM * left.shape[1] / 2)] = WHITE
    return picture
