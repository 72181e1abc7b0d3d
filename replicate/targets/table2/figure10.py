"""Figure 10: one wrinkled test pose as every method predicts it, shaded above, normal error below."""

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from replicate.approximation.metrics import normal_error
from replicate.drawing.heatmap import colour_bar, normal_heat
from replicate.drawing.panels import Words, panel_grid
from replicate.drawing.render import render
from replicate.drawing.scene import camera_for
from replicate.methods.method_registry import in_order, method_named
from replicate.report.pose_record import TRUTH, PoseRecord
from replicate.targets.table2.clay_surfaces import clay_surfaces
from replicate.targets.table2.panel_titles import panel_title, plain_name

if TYPE_CHECKING:
    import matplotlib.figure


def figure10(
    record: PoseRecord,
    limit_deg: float = 10.0,
    camera: str = "front",
    width: int = 232,
    height: int = 292,
    renderer: str | None = None,
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words). limit_deg: the upper end of the colours, the same for every panel."""
    view = camera_for(camera, record.neutral)
    columns = [TRUTH, *(m for m in in_order(set(record.vertices) - {TRUTH}) if method_named(m).in_figures)]
    truth = record.vertices[TRUTH]
    draw = partial(render, camera=view, width=width, height=height, renderer=renderer)
    clay = [draw(clay_surfaces(record, method)) for method in columns]
    heat = [draw([normal_heat(record.vertices[method], truth, record.faces, limit_deg)]) for method in columns]
    figure = panel_grid(
        [clay, heat],
        [panel_title(method) for method in columns],
        ("surface", "normal error"),
        (1, 1, partial(colour_bar, limit=limit_deg, label="normal angle error, degrees")),
    )
    means = {method: np.nanmean(normal_error(record.vertices[method], truth, record.faces)) for method in columns[1:]}
    names = ", ".join(f"{plain_name(method)} {mean:.2f}°" for method, mean in means.items())
    return figure, Words(
        f"Clay renders of one face pose in {len(columns)} columns, ground truth first, then each method; below each, "
        f"the same face coloured by normal error from 0 to {limit_deg:g} degrees. Mean errors: {names}.",
        f"Test pose {record.pose} of {record.character}, the one whose forehead folds most (after Fig. 10). "
        f"Below: angle between each face's predicted and true normal (Eq. 11), unlit, one scale for all panels. "
        f"Means over the whole mesh in this pose: {names}.",
    )
