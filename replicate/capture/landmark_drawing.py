"""Landmarks as a picture: points, with the lines of brows, eyes, nose and mouth through them."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, UInt8

from replicate.drawing.panels import DPI

RED, GREY = "#d62728", "#8a8a8a"
MARGIN = 0.12  # around the landmarks, as a share of their height
CHAINS = (  # beginnings of names whose landmarks a line joins in their order; True: back to the first one
    ("chin_", False),
    ("brow_right", False),
    ("brow_left", False),
    ("nose_bridge", False),
    ("below nose", False),
    ("eye_right", True),
    ("eye_left", True),
    ("outer lip", True),
    ("seam", True),
)


def landmark_picture(
    places: Float[np.ndarray, "l 2"],
    names: Sequence[str],
    window: tuple[Float[np.ndarray, " 2"], Float[np.ndarray, " 2"]],
    width: int,
    height: int,
) -> UInt8[np.ndarray, "h w 3"]:
    """Return a picture of one frame's landmarks. window: the lower left and the upper right corner of what is shown."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure((width / DPI, height / DPI), dpi=DPI, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    for chain, closed in CHAINS:
        own = [k for k, name in enumerate(names) if _belongs(name, chain)]
        own = own + own[:1] if closed else own
        axes.plot(*places[own].T, color=GREY, linewidth=width / 160, solid_joinstyle="round")
    axes.plot(*places.T, "o", color=RED, markersize=width / 55, markeredgewidth=0)
    (left, bottom), (right, top) = window
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def window_of(places: Float[np.ndarray, "t l 2"], aspect: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of a window of this width over height that shows the landmarks of all frames."""
    low, high = places.min(axis=(0, 1)), places.max(axis=(0, 1))
    tall = (1 + 2 * MARGIN) * max(high[1] - low[1], (high[0] - low[0]) / aspect)
    half = np.array([aspect * tall, tall]) / 2
    return (low + high) / 2 - half, (low + high) / 2 + half


def _belongs(name: str, chain: str) -> bool:
    if chain == "outer lip":
        return name.startswith(("lip_", "mouth_"))
    if chain == "below nose":
        return name.startswith(("nose_wing", "nostril", "nose_base"))
    if chain == "nose_bridge":
        return name.startswith(("nose_bridge", "nose_tip"))
    return name.startswith(chain) or (chain == "chin_" and name == "chin")
