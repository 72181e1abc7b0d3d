"""Figure 10: one wrinkled test pose as every method predicts it, shaded above, normal error below."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from replicate.evaluation.pose import TRUTH, PoseRecord
from replicate.figures.heatmap import colour_bar, normal_heat
from replicate.figures.panels import Words, panel_grid
from replicate.figures.render import render
from replicate.figures.scene import Surface, camera_for
from replicate.figures.style import TITLES, plain_name
from replicate.metrics import normal_error

SHOWN = ("coarse", "refined", "dense", "lbs16", "lbs24", "lbs32")


def figure10(
    record: PoseRecord,
    limit_deg: float = 10.0,
    camera: str = "front",
    methods: Sequence[str] = SHOWN,
    width: int = 232,
    height: int = 292,
    renderer=None,
):
    """Return (figure, words). limit_deg: the upper end of the colours, the same for every panel."""
    view = camera_for(camera, record.neutral)
    shown = [TRUTH, *(method for method in methods if method in record.vertices)]
    props = [Surface(vertices, faces, colour) for _, vertices, faces, colour in record.props]
    truth = record.vertices[TRUTH]
    draw = partial(render, camera=view, width=width, height=height, renderer=renderer)
    shaded = [draw([Surface(record.vertices[label], record.faces), *props]) for label in shown]
    heat = [draw([normal_heat(record.vertices[label], truth, record.faces, limit_deg)]) for label in shown]
    figure = panel_grid(
        [shaded, heat],
        [TITLES[label] for label in shown],
        ("surface", "normal error"),
        (1, 1, partial(colour_bar, limit=limit_deg, label="normal angle error, degrees")),
    )
    means = {label: np.nanmean(normal_error(record.vertices[label], truth, record.faces)) for label in shown[1:]}
    listed = ", ".join(f"{plain_name(label)} {mean:.2f}°" for label, mean in means.items())
    return figure, Words(
        f"Clay renders of one face pose in {len(shown)} columns, ground truth first, then each method; below each, "
        f"the same face coloured by normal error from 0 to {limit_deg:g} degrees. Mean errors: {listed}.",
        f"Test pose {record.pose} of {record.character}, the one whose forehead folds most (after Fig. 10). "
        f"Below: angle between each face's predicted and true normal (Eq. 11), unlit, one scale for all panels. "
        f"Means over the whole mesh in this pose: {listed}.",
    )
