"""Figure 11: a few configurations of control points, and the faces that they lead to: of the rig, and as predicted."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from data_recipes.rig import Rig
from replicate.approximation.metrics import angle_between, vertex_error
from replicate.artefacts import built_rig, control_influence
from replicate.drawing.face_sheet import Cell, cell_width, face_sheet
from replicate.drawing.marker_balls import balls_in_front
from replicate.drawing.panels import Words
from replicate.drawing.prop_surfaces import carry_props, prop_surfaces
from replicate.drawing.render import render
from replicate.drawing.scene import Surface, camera_for
from replicate.geometry.normals import face_vectors
from replicate.inverse import ik_stage
from replicate.inverse.configurations import configurations
from replicate.inverse.control_points import control_points
from replicate.methods.measurement import predictor
from replicate.methods.method_registry import method_named
from replicate.report.character_words import with_layout
from replicate.targets.figure11.posed_picture import PosedPicture

if TYPE_CHECKING:
    import matplotlib.figure

COUNT, TALL = 3, 1.2  # configurations, those with the most points; a picture's height over its width
FARTHEST_MM = 40.0  # that a vertex is drawn from where the rig has it: some approximations fly apart
TITLE = "the rig"
LINES = ("distance", "normal error")


def figure11(
    settings: PosedPicture, inputs: Mapping[str, Path], files: Sequence[Path], renderer: str | None = None
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): a row a configuration, the rig first, then each approximation at the same parameters.

    files: that of the character's drags, or none.
    """
    rig = built_rig.load(inputs)
    fed_by = settings.methods[0].method
    targets = configurations(rig, control_points(rig, control_influence.load(inputs)), files)
    rest = rig.mesh.neutral[rig.control_points]
    dragged = (np.abs(targets - rest).max(axis=2) > 0).sum(axis=1)
    chosen = np.sort(np.argsort(-dragged, kind="stable")[:COUNT])
    params = ik_stage.load(inputs, fed_by).solve(targets[chosen])
    truth = rig(params)
    predicted = {one.method: predictor(one, inputs)(params, truth) for one in settings.methods}
    columns = 1 + len(predicted)
    width = cell_width(columns, LINES)
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
                renderer=renderer,
            )
            cells.append(Cell(title if k == 0 else "", (picture,), lines))
            if title != TITLE:
                phrases.append(f"row {k + 1}, {title}: {' and '.join(lines)}")
    errors, source = "; ".join(phrases), method_named(fed_by).label
    whose = with_layout(settings.character, rig.mesh.segment_names)
    return face_sheet(cells, columns, LINES), Words(
        f"Clay renders of {whose} in {COUNT} poses, with control points in red; from left to right the rig and its "
        f"approximations. Mean errors: {errors}.",
        f"Faces of {whose} that inverse kinematics poses, after Fig. 11. Red: where the control points shall go. "
        f"{dragged_points(dragged[chosen], targets.shape[1])}, by up to 25 mm, which the rig can't always follow. All "
        f"faces of a row have the parameters of the same IK networks, which are trained through the model {source}. "
        "Below: mean distance from the rig, and mean angle between normals (Eq. 11). What an approximation throws "
        f"farther than {FARTHEST_MM:g} mm is drawn at that distance.",
    )


def dragged_points(counts: Int[np.ndarray, " k"], points: int) -> str:
    """Return in words how many of a character's points are dragged; counts: of each configuration."""
    few, many = counts.min(), counts.max()
    count, verb = (f"{few}", "is" if few == 1 else "are") if few == many else (f"From {few} to {many}", "are")
    return f"{count} of the {points} points {verb} dragged"


def held(vertices: Float[np.ndarray, "n 3"], truth: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Return vertices that are at most FARTHEST_MM from where the rig has them, for a picture to show them."""
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
