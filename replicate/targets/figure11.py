"""Figure 11: faces that inverse kinematics poses, the rig beside its approximations, with the control points."""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from data_recipes.rig import Rig
from replicate.approximation.metrics import angle_between, vertex_error
from replicate.cli.running import make
from replicate.drawing.face_sheet import Cell, cell_width, face_sheet
from replicate.drawing.marks import balls_in_front
from replicate.drawing.panels import Words, save_figure
from replicate.drawing.prop_surfaces import carry_props, prop_surfaces
from replicate.drawing.render import render
from replicate.drawing.scene import Surface, camera_for
from replicate.engine.stage import Stage, StageContext
from replicate.geometry.mesh import face_vectors
from replicate.inverse import ik_stage
from replicate.inverse.configurations import configurations
from replicate.inverse.control_points import control_points
from replicate.methods import artefacts, measurement
from replicate.methods.measurement import MeasurementSettings, predictor
from replicate.methods.method import Method
from replicate.methods.method_registry import choose, method_named
from replicate.methods.plan import Plan
from replicate.report.pose_record import with_layout
from replicate.report.publication import publish_pictures
from replicate.targets.shown_records import posing_stage

if TYPE_CHECKING:
    import matplotlib.figure


SHOWN = ("refined", "dense", "regional")


def stages(plan: Plan, methods: Sequence[Method] = ()) -> list[Stage]:
    """Return the stages of one character's figure, those of the methods, the slow ones, first."""
    shown = choose(SHOWN, plan.config)
    trained = ik_stage.stage(plan, shown[0])
    settings = PosedPicture(
        plan.character, tuple(measurement.measurement_settings(method, plan.config) for method in shown)
    )
    slow = [stage for method in shown for stage in method.stages(plan)]
    inputs = (*trained.inputs, artefacts.rigid_stage(plan), *slow, trained)
    return [*slow, trained, posing_stage(plan, "figure11", draw, settings, shown, inputs)]


def draw(context: StageContext) -> None:
    """Draw the faces that some configurations of control points lead to (Fig. 11)."""
    figure, words = figure11(context.config, context.inputs, context.files)
    save_figure(figure, context.out / f"figure11_{context.config.character}.png", words)


def run(options: argparse.Namespace) -> None:
    """Draw the figure of every character, publish it, and execute its notebook, which opens the poser too."""
    publish_pictures("figure11", make(options, stages))


# The settings of Figure 11's stage.


@dataclass(frozen=True)
class PosedPicture:
    """The character, and the methods shown beside the rig; the IK networks are trained through the first of them."""

    character: str
    methods: tuple[MeasurementSettings, ...]


# Figure 11: a few configurations of control points, and the faces that they lead to: of the rig, and as predicted.

COUNT, TALL = 3, 1.2  # configurations, those with the most points; a picture's height over its width
FARTHEST_MM = 40.0  # the largest distance from the rig at which a vertex is drawn: some approximations fly apart
TITLE = "the rig"


def figure11(
    settings: PosedPicture, inputs: Mapping[str, Path], files: Sequence[Path]
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): a row for each configuration, the rig, then the approximations at the same parameters.

    files: the file of the character's drags, if it has one.
    """
    # the configurations with the most points, posed
    rig = artefacts.load_rig(inputs)
    fed_by = settings.methods[0].method
    targets = configurations(rig, control_points(rig, artefacts.load_influence(inputs)), files)
    rest = rig.mesh.neutral[rig.control_points]
    dragged = (np.abs(targets - rest).max(axis=2) > 0).sum(axis=1)
    chosen = np.sort(np.argsort(-dragged, kind="stable")[:COUNT])
    params = ik_stage.load(inputs, fed_by).solve(targets[chosen])
    truth = rig(params)
    predicted = {entry.method: predictor(entry, inputs)(params, truth) for entry in settings.methods}
    # a row of faces for each
    columns = 1 + len(predicted)
    width = cell_width(columns)
    cells, phrases = [], []
    for k in range(len(chosen)):
        points = balls_in_front(targets[chosen[k]], truth[k])
        faces = {TITLE: truth[k]} | {method_named(name).label: vertices[k] for name, vertices in predicted.items()}
        for title, vertices in faces.items():
            lines = ("", "") if title == TITLE else _errors(rig, vertices, truth[k])
            picture = render(
                [*_surfaces(rig, params[k], truth[k], held(vertices, truth[k])), points],
                camera_for("front", rig.mesh.neutral),
                width,
                round(TALL * width),
            )
            cells.append(Cell(title if k == 0 else "", (picture,), lines))
            if title != TITLE:
                phrases.append(f"row {k + 1}, {title}: {' and '.join(lines)}")
    # the caption
    errors, source = "; ".join(phrases), method_named(fed_by).label
    whose = with_layout(settings.character, rig.mesh.segment_names)
    return face_sheet(cells, columns), Words(
        f"Clay renders of {whose} in {COUNT} poses, with control points in red; from left to right the rig and its "
        f"approximations. Mean errors: {errors}.",
        f"Faces of {whose} that inverse kinematics poses, after Fig. 11. Red: where the control points shall go. "
        f"{dragged_points(dragged[chosen], targets.shape[1])}, by up to 25 mm, which the rig can't always follow. All "
        f"faces of a row have the parameters of the same IK networks, which are trained through the model {source}. "
        "Below: mean distance from the rig, and mean angle between normals (Eq. 11). What an approximation throws "
        f"farther than {FARTHEST_MM:g} mm is drawn at that distance.",
    )


def dragged_points(counts: Int[np.ndarray, " k"], points: int) -> str:
    """Return in words how many of a character's points are dragged. counts: dragged points in each configuration."""
    few, many = counts.min(), counts.max()
    count, verb = (f"{few}", "is" if few == 1 else "are") if few == many else (f"From {few} to {many}", "are")
    return f"{count} of the {points} points {verb} dragged"


def held(vertices: Float[np.ndarray, "n 3"], truth: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Move vertices that lie farther than FARTHEST_MM from the rig's back to that distance, so that a picture fits."""
    apart = vertices - truth
    length = np.linalg.norm(apart, axis=1, keepdims=True)
    return truth + apart * np.minimum(1.0, FARTHEST_MM / np.maximum(length, 1e-9))


def _surfaces(rig: Rig, params: np.ndarray, truth: np.ndarray, vertices: np.ndarray) -> list[Surface]:
    props = carry_props(tuple(rig.pose_props(params)), truth, vertices)
    return [Surface(vertices, rig.mesh.faces), *prop_surfaces(props)]


def _errors(rig: Rig, vertices: np.ndarray, truth: np.ndarray) -> tuple[str, str]:
    normals = (face_vectors(each[None], rig.mesh.faces) for each in (vertices, truth))
    degrees = np.nanmean(angle_between(*normals))
    return f"{vertex_error(vertices[None], truth[None]).mean():.2f} mm", f"{degrees:.2f}°"
