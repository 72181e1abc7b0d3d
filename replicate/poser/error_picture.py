"""A posed face as a still picture: the rig's, our method's, and its errors in colours."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float32

from data_recipes.rig import Rig
from replicate.drawing.heatmap import ROOT, colour_bar
from replicate.drawing.marks import balls_in_front
from replicate.drawing.panels import Words, panel_grid
from replicate.drawing.prop_surfaces import carry_props, prop_surfaces
from replicate.drawing.render import render
from replicate.drawing.scene import Surface, camera_for
from replicate.poser.rig_errors import NORMAL, SCALES, RigErrors, Scale

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.figure

    from replicate.poser.notebook import Poser

WIDTH, HEIGHT = 270, 324  # pixels of a picture
TITLES = ("the rig", "our method")


def still(poser: "Poser") -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): the pose that a widget has now, for those who read without a kernel."""
    words = f"{poser.face.rig.name}: {poser.judged.in_words()}"
    figure = error_figure(poser.face.rig, poser.params, poser.targets, poser.judged, poser.kind)
    return figure, Words(
        f"A posed face of {words}.",
        f"A pose of the widget, {words}. Red: where the control points are wanted. Right: our method's face, each "
        "vertex in the colour of its error against the rig at the same parameters.",
    )


def error_figure(
    rig: Rig,
    params: Float32[np.ndarray, " m"],
    targets: Float[np.ndarray, "c 3"],
    errors: RigErrors,
    kind: str = NORMAL,
) -> "matplotlib.figure.Figure":
    """Return pictures of the rig's face, our method's, and its errors in colours with their bar.

    rig: for its faces and props
    params: raw rig parameters of the pose
    targets: where the control points are wanted, mm
    errors: the pose's
    kind: NORMAL or DISTANCE, the errors shown
    """
    scale, faces, camera = SCALES[kind], rig.mesh.faces, camera_for("front", rig.mesh.neutral)
    props = tuple(rig.pose_props(params))

    def picture(vertices: np.ndarray, surface: Surface, marks: tuple[Surface, ...]) -> np.ndarray:
        others = prop_surfaces(carry_props(props, errors.truth, vertices))
        return render([surface, *others, *marks], camera, WIDTH, HEIGHT)

    points, heat = (balls_in_front(targets, errors.truth),), scale.colours(errors.of(kind))
    pictures = [
        picture(errors.truth, Surface(errors.truth, faces), points),
        picture(errors.predicted, Surface(errors.predicted, faces), points),
        picture(errors.predicted, Surface(errors.predicted, faces, lit=False, paint=heat), ()),
    ]
    return panel_grid([pictures], (*TITLES, scale.title), bar=(0, 0, _bar(scale)))


def _bar(scale: Scale) -> Callable:
    def draw(figure: "matplotlib.figure.Figure", axes: "matplotlib.axes.Axes") -> None:
        bar = colour_bar(figure, axes, scale.limit, f"{scale.title}, {scale.unit}", ROOT)
        bar.set_ticks(list(scale.ticks), labels=[f"{tick:g}" for tick in scale.ticks])

    return draw
