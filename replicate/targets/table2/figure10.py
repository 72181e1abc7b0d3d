"""Figure 10: one wrinkled test pose as every method predicts it, shaded above, normal error below."""

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float

from replicate.approximation.metrics import normal_error
from replicate.drawing.heatmap import normal_bar, normal_heat
from replicate.drawing.panels import Words, panel_grid
from replicate.drawing.render import render
from replicate.drawing.scene import camera_for, forehead_faces
from replicate.methods.method_registry import in_order, method_named
from replicate.report.pose_record import TRUTH, PoseRecord
from replicate.targets.table2.clay_surfaces import clay_surfaces
from replicate.targets.table2.panel_titles import panel_title, plain_name

if TYPE_CHECKING:
    import matplotlib.figure


def figure10(
    record: PoseRecord,
    limit_deg: float = 30.0,
    camera: str = "front",
    width: int = 176,
    height: int = 222,
    renderer: str | None = None,
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words). limit_deg: the upper end of the colours, the same for every panel."""
    view = camera_for(camera, record.neutral)
    columns = [TRUTH, *(m for m in in_order(set(record.vertices) - {TRUTH}) if method_named(m).in_figures)]
    truth = record.vertices[TRUTH]
    draw = partial(render, camera=view, width=width, height=height, renderer=renderer)
    clay = [draw(clay_surfaces(record, method)) for method in columns]
    heat = [draw([normal_heat(record.vertices[method], truth, record.faces, limit_deg)]) for method in columns]
    forehead = forehead_faces(record.neutral, record.faces)
    means = {method: _means(normal_error(record.vertices[method], truth, record.faces), forehead) for method in columns}
    numbers = [f"{whole:.2f}° · {front:.1f}°" for whole, front in means.values()]
    figure = panel_grid(
        [clay, heat],
        [[panel_title(method) for method in columns], ["mean: head · forehead", *numbers[1:]]],
        ("surface", "normal error"),
        (1, 1, partial(normal_bar, limit_deg=limit_deg)),
    )
    names = ", ".join(f"{plain_name(method)} {means[method][0]:.2f}°" for method in columns[1:])
    return figure, Words(
        f"Clay renders of one face pose in {len(columns)} columns, ground truth first, then each method; below each, "
        f"the same face coloured by normal error from 0 to {limit_deg:g} degrees. Mean errors: {names}.",
        f"Test pose {record.pose} of {record.character}, the one whose forehead folds most (after Fig. 10). "
        f"Below: angle between each face's predicted and true normal (Eq. 11), unlit, one scale for all panels, whose "
        "colours go with the angle's root. Between the rows: means over the whole mesh and over the skin between brows "
        f"and hair line, in this pose. Over the mesh: {names}.",
    )


def _means(errors: Float[np.ndarray, " f"], forehead: Bool[np.ndarray, " f"]) -> tuple[float, float]:
    return float(np.nanmean(errors)), float(np.nanmean(errors[forehead]))
