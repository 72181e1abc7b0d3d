"""Figure 13 between characters: the original in one pose, and other characters' faces that are moved like it."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from replicate.approximation.metrics import normal_error, vertex_error
from replicate.artefacts import built_rig
from replicate.drawing.face_sheet import Cell, cell_width, face_sheet
from replicate.drawing.panels import Words
from replicate.drawing.render import render
from replicate.drawing.scene import Surface, camera_for, frame_surfaces
from replicate.targets.figure13 import other_faces

if TYPE_CHECKING:
    import matplotlib.figure

MOVED = {"coarse": "coarse networks", "deformation_transfer": "deformation transfer †"}
HEAD, CLOSE = 1.35, 0.8  # a picture's height over its width
LINES = ("distance", "normal error")


def sheet_of_others(
    character: str, inputs: Mapping[str, Path], folders: Mapping[str, Path], across: int | None = None
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): a row for each other face, the whole of it and its mouth close up below.

    folders: other characters' names → the artefacts of their stages. across: the width of one picture, pixels; None for
    what fills the sheet.
    """
    from replicate.transfer.face_surface import face_of

    mesh = built_rig.load_mesh(inputs)
    width, cells, told = across or cell_width(2 + len(MOVED), LINES), [], []
    for other, folder in folders.items():
        pose, about = other_faces.load_pose(folder), other_faces.load_alignment(folder)
        cells.append(Cell(f"{character}: the rig", _pictures(pose["source"], mesh.neutral, face_of(mesh).faces, width)))
        errors = {way: _errors(pose, way) if about["controls"] else ("–", "–") for way in MOVED}
        for way, title in MOVED.items():
            pictures = _pictures(pose[way], pose["head"], pose["faces"], width)
            cells.append(Cell(f"{other}: {title}", pictures, errors[way]))
        title = f"{other}: its own rig" if about["controls"] else f"{other}: neutral"
        cells.append(Cell(title, _pictures(pose["own"], pose["head"], pose["faces"], width)))
        told.append(_in_words(other, about, errors))
    return face_sheet(cells, 2 + len(MOVED), LINES), Words(
        "Rows of four clay faces without eyes and teeth, their mouths close up below. First the face that the "
        "networks are trained on, then another character's face: moved by the coarse networks, moved by deformation "
        "transfer, and as its own rig has it. " + " ".join(told),
        f"The coarse networks of {character} move the faces of other characters (after Fig. 13), in the test pose "
        "whose forehead folds most. A thin-plate spline through landmarks that both have brings the other face to the "
        f"charts; offsets are scaled by the ratio of distances between landmarks. {' '.join(told)} Another person's "
        "own rig is no truth: it says how that person would do the same, with other folds and proportions. † Each "
        "triangle follows its nearest one on the rig's own posed mesh (Sumner and Popović 2004), aligned alike.",
    )


def _in_words(other: str, about: Mapping[str, float], errors: Mapping[str, tuple]) -> str:
    aligned = f"{other}: {about['landmarks']} landmarks, scale {about['scale']:.2f}"
    if not about["controls"]:
        return f"{aligned}; its rig has no control of the same name, so that its neutral face stands last."
    means = ", ".join(f"{MOVED[way].removesuffix(' †')} {' and '.join(own)}" for way, own in errors.items())
    return f"{aligned}, {about['controls']} controls of the same names; mean differences from its own rig: {means}."


def _pictures(posed: np.ndarray, neutral: np.ndarray, faces: np.ndarray, width: int) -> tuple[np.ndarray, ...]:
    surface, used = Surface(posed, faces), np.unique(faces)
    framed = Surface(posed[used], np.zeros((0, 3), np.int32))
    head = frame_surfaces(camera_for("front", neutral), [framed], 1 / HEAD)
    return (
        render([surface], head, width, round(HEAD * width)),
        render([surface], camera_for("mouth", neutral), width, round(CLOSE * width)),
    )


def _errors(pose: Mapping[str, np.ndarray], way: str) -> tuple[str, str]:
    degrees = np.nanmean(normal_error(pose[way], pose["own"], pose["faces"]))
    return f"{vertex_error(pose[way], pose['own']).mean():.2f} mm", f"{degrees:.2f}°"
