"""One style for all charts, in letters that a column's width leaves legible."""

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import matplotlib.axes

WIDTH = 10.0  # inches; a column of the paper shows a third of it
LETTER_PT = 15.5  # the size of letters in a chart so wide: 5 points in a column
MEASURES = (
    ("vertex_error_mean", "mm", "distance error, mm"),
    ("normal_error_mean", "deg", "normal angle error, degrees"),
)


def tidy(axes: "matplotlib.axes.Axes") -> None:
    """Take away what a chart doesn't need."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.25, linewidth=0.5)
    axes.set_axisbelow(True)


def enlarge(axes: "matplotlib.axes.Axes", size_pt: float = LETTER_PT) -> None:
    """Give all words and numbers that a chart has so far one size, in points."""
    axes.tick_params(which="both", labelsize=size_pt)
    legend = axes.get_legend()
    for text in (axes.title, axes.xaxis.label, axes.yaxis.label, *axes.texts, *(legend.get_texts() if legend else ())):
        text.set_fontsize(size_pt)


def error_scale(axes: "matplotlib.axes.Axes", which: str = "x") -> None:
    """Make an axis logarithmic, so that equal distances are equal ratios, with plain numbers as its ticks.

    which: "x" or "y". To be called after everything is drawn: the shorter an axis, the more numbers a decade.
    """

    from matplotlib.ticker import LogLocator, NullFormatter

    (axes.set_xscale if which == "x" else axes.set_yscale)("log")
    low, high = axes.get_xlim() if which == "x" else axes.get_ylim()
    axis = axes.xaxis if which == "x" else axes.yaxis
    decades = abs(math.log10(high / low))
    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if decades < 1.6 else (1, 3) if decades < 2.5 else (1,)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())
