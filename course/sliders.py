"""Figures that move: stills on the page for everybody, and sliders beside them where a kernel runs."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from replicate.drawing.panels import Words, png
from replicate.report.notebooks import show

if TYPE_CHECKING:
    import matplotlib.figure


def move(
    draw: Callable[..., "matplotlib.figure.Figure"],
    sliders: Mapping[str, tuple[float, float, float]],
    stills: Sequence[Mapping[str, float]],
    words: Words,
) -> None:
    """Show a figure at a few settings, and with sliders for all others.

    draw: called with a number for each slider, by its name; returns a figure
    sliders: name → (lowest, highest, where it starts); they are not stored with a notebook
    stills: the settings on the page, at most four
    """
    import ipywidgets
    from IPython.display import display

    show(beside([draw(**still) for still in stills]), words)
    handles = {
        name: ipywidgets.FloatSlider(
            description=name.replace("_", " "),
            value=start,
            min=low,
            max=high,
            step=(high - low) / 50,
            continuous_update=False,
            style={"description_width": "initial"},  # as wide as the name
        )
        for name, (low, high, start) in sliders.items()
    }
    # no Output widget: a notebook that is run without a page may wait for it; and not stretched to the page's width
    picture = ipywidgets.Image(format="png", layout={"align_self": "flex-start"})

    def follow(change: object = None) -> None:
        picture.value = png(draw(**{name: handle.value for name, handle in handles.items()}), words)

    for handle in handles.values():
        handle.observe(follow, "value")
    follow()
    display(ipywidgets.VBox([*handles.values(), picture]))


def beside(figures: Sequence["matplotlib.figure.Figure"]) -> "matplotlib.figure.Figure":
    """Return one figure of several, side by side."""
    import numpy as np
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    pixels = []
    for figure in figures:
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        pixels.append(np.asarray(canvas.buffer_rgba())[..., :3])
    height = max(len(picture) for picture in pixels)
    whole = [np.pad(p, ((0, height - len(p)), (0, 0), (0, 0)), constant_values=255) for p in pixels]
    row = np.concatenate(whole, axis=1)
    out = Figure((row.shape[1] / 100, height / 100), dpi=100)
    out.add_axes((0, 0, 1, 1)).imshow(row)
    out.axes[0].set_axis_off()
    return out
