"""One colour and one name for each method in every chart."""

from replicate.report.pose_record import TRUTH
from replicate.targets.table2.layout import title

# Okabe and Ito's colours, told apart by readers who see fewer of them.
COLOURS = {
    "coarse": "#E69F00",
    "refined": "#0072B2",
    "dense": "#D55E00",
    "lbs16": "#BBBBBB",
    "lbs24": "#888888",
    "lbs32": "#555555",
    "driven": "#F0E442",
    "floor": "#009E73",
    "floor_refined": "#56B4E9",
    "neutral": "#CC79A7",
}
MEASURES = (
    ("vertex_error_mean", "mm", "vertex error, mm"),
    ("normal_error_mean", "deg", "normal angle error, degrees"),
)


def colour(method: str) -> str:
    """Return a method's colour; other numbers of bones are as grey as 24."""
    return COLOURS.get(method, COLOURS["lbs24"])


def label(method: str) -> str:
    """Return a method's name as a panel's title, or that of the truth."""
    return "Ground truth" if method == TRUTH else title(method)


def plain_name(method: str) -> str:
    """Return a method's name without the marks of the printed tables."""
    return label(method).rstrip(" †‡¶§◊")


def tidy(axes) -> None:
    """Take away what a chart doesn't need."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.25, linewidth=0.5)
    axes.set_axisbelow(True)
