"""One colour and one name for each method in every chart."""

from replicate.evaluation.pose import TRUTH
from replicate.evaluation.table2 import METHODS

# Okabe and Ito's colours, told apart by readers who see fewer of them.
COLOURS = {
    "coarse": "#E69F00",
    "refined": "#0072B2",
    "dense": "#D55E00",
    "lbs16": "#BBBBBB",
    "lbs24": "#888888",
    "lbs32": "#555555",
    "floor": "#009E73",
    "floor_refined": "#56B4E9",
    "neutral": "#CC79A7",
}
MEASURES = (
    ("vertex_error_mean", "mm", "vertex error, mm"),
    ("normal_error_mean", "deg", "normal angle error, degrees"),
)


TITLES = {TRUTH: "Ground truth"} | METHODS


def plain_name(method: str) -> str:
    """Return a method's name without the marks of the printed tables."""
    return TITLES.get(method, method).rstrip(" †‡¶§")


def tidy(axes) -> None:
    """Take away what a chart doesn't need."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.25, linewidth=0.5)
    axes.set_axisbelow(True)
