"""Figure 12: frames of performances, and below each the character that their landmarks drive."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from replicate.capture import landmark_rig
from replicate.capture.face_pictures import face_picture, head_camera
from replicate.drawing.face_sheet import Cell, face_sheet
from replicate.drawing.panels import Words
from replicate.methods.method_registry import method_named
from replicate.targets.figure12 import acted_landmarks
from replicate.targets.figure12.capture_trial import CaptureTrial
from replicate.targets.figure12.driven_motions import Driver, exact, targets_of

if TYPE_CHECKING:
    import matplotlib.figure


def figure12(
    trial: CaptureTrial, inputs: Mapping[str, Path], driver: Driver, renderer: str | None = None
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): for each actor a row of its frames and a row of the character that it drives.

    driver: what leads from landmarks to the face. The landmarks are exact, and smoothed as the configuration says.
    """
    rig = landmark_rig.load(inputs)
    height, width = acted_landmarks.picture_size()
    camera = head_camera(rig, width / height)
    cells, parts = [], []
    for actor in trial.actors:
        acted = acted_landmarks.load(inputs, actor)
        targets, scale = targets_of(trial, exact(acted), rig, trial.section.smoothing_frames)
        shown = acted.shown.tolist()
        params = np.clip(driver.solve(targets[shown]), rig.lower, rig.upper).astype(np.float32)
        apart = np.linalg.norm((driver.face(params)[:, rig.control_points] - targets[shown])[..., :2], axis=-1).mean(1)
        for k, (frame, picture) in enumerate(zip(shown, acted.pictures, strict=True)):
            driven = face_picture(driver.face, params[k], camera, width, height, renderer)
            cells.append(Cell(f"{actor}, {frame}", (picture, driven), (f"{apart[k]:.1f} mm",)))
        parts.append(f"{actor} acts, scale {scale:.2g}, {apart.mean():.2f} mm")
    label, actors = method_named(driver.name).label.lower(), " and then ".join(trial.actors)
    return face_sheet(cells, len(shown)), Words(
        f"Pairs of clay heads: an actor with 54 red landmarks, and below it {trial.character} with the expression that "
        f"they lead to. Means of how far landmarks end from where they shall go: {'; '.join(parts)}.",
        f"Performance capture (after Fig. 12). Upper faces: the actor, first {actors}, a rig whose landmarks are known "
        f"exactly; above them the frame. Lower faces: {trial.character}, driven by the landmarks' movement through IK "
        f"networks; the mesh is that of the {label} networks. Below: the mean distance of the landmarks from where "
        "they shall go, in the image plane.",
    )
