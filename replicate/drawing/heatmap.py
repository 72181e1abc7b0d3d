"""Errors as colours on the mesh, never shaded, with one scale for all panels (Fig. 10)."""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int, UInt8

from replicate.approximation.metrics import normal_error
from replicate.drawing.scene import Surface

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.colorbar
    import matplotlib.figure

COLOUR_MAP = "viridis"  # perceptually uniform, and in order for readers who see fewer colours
NO_NORMAL = (200, 200, 200)  # faces that Eq. 11 leaves out


def error_colours(errors: Float[np.ndarray, " f"], limit: float) -> UInt8[np.ndarray, "f 3"]:
    """Return each face's colour for an error from 0 to `limit`; larger ones get the last colour, NaN grey."""
    from matplotlib import colormaps

    colours = np.rint(colormaps[COLOUR_MAP](np.nan_to_num(errors) / limit)[:, :3] * 255).astype(np.uint8)
    colours[np.isnan(errors)] = NO_NORMAL
    return colours


def normal_heat(
    predicted: Float[np.ndarray, "n 3"],
    truth: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "f 3"],
    limit_deg: float,
) -> Surface:
    """Return the predicted surface, each face coloured by its normal's error (Eq. 11) in degrees."""
    return Surface(
        predicted, faces, error_colours(normal_error(predicted, truth, faces), limit_deg), lit=False, smooth=False
    )


def colour_bar(
    figure: "matplotlib.figure.Figure", axes: "matplotlib.axes.Axes", limit: float, label: str
) -> "matplotlib.colorbar.Colorbar":
    """Draw the bar of `error_colours` in `axes`; the label has the unit, an arrow shows that it saturates."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    bar = figure.colorbar(ScalarMappable(Normalize(0, limit), COLOUR_MAP), cax=axes, extend="max")
    bar.set_label(label)
    bar.outline.set_linewidth(0.5)
    return bar
