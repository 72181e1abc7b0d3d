"""One style for all charts."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import matplotlib.axes

MEASURES = (
    ("vertex_error_mean", "mm", "vertex error, mm"),
    ("normal_error_mean", "deg", "normal angle error, degrees"),
)


def tidy(axes: "matplotlib.axes.Axes") -> None:
    """Take away what a chart doesn't need."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.25, linewidth=0.5)
    axes.set_axisbelow(True)
