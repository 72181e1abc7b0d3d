"""What `make capture` writes of a recording: parameters, an animated GLB, and a strip of frames (§5.3.2)."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from data_recipes.rig import Rig
from replicate.capture import landmark_ik, landmark_rig
from replicate.capture.capture_config import CaptureConfig
from replicate.capture.capture_numbers import CaptureNumbers
from replicate.capture.driven_face import ApproximatedRig, driven_params
from replicate.capture.face_pictures import face_picture, head_camera
from replicate.capture.landmark_drawing import landmark_picture, window_of
from replicate.capture.landmark_file import Recording, read_landmarks
from replicate.capture.landmark_motion import Motion, control_motion, telling_frames
from replicate.drawing.face_sheet import LARGEST_BYTES, Cell, cell_width, face_sheet
from replicate.drawing.panels import Words, save_figure
from replicate.engine.tidy_files import Column, write_csv
from replicate.export.animation import FRAMES_PER_SECOND, animated_glb
from replicate.export.parts import moving_parts
from replicate.methods.measurement import predictor

if TYPE_CHECKING:
    import matplotlib.figure

STEM = "capture"  # of the files' names
FRAMES, TALL = 5, 1.2  # frames of a strip; a picture's height over its width
TOLERANCE_MM = 0.25  # that a vertex of the GLB may be off: less than a landmark is


def write_all(settings: CaptureNumbers, inputs: Mapping[str, Path], file: Path, out: Path) -> dict:
    """Write a recording's files into a folder and return facts about it. file: the recording, as CSV."""
    rig, section = landmark_rig.load(inputs), settings.section
    recording = read_landmarks(file, rig.control_point_names, section.longest_gap)
    motion = control_motion(recording, rig.mesh.neutral[rig.control_points], section)
    params = driven_params(landmark_ik.load(inputs, settings.method.method), motion.targets, rig)
    face = ApproximatedRig(rig, predictor(settings.method, inputs))
    write_params(out / f"{STEM}_parameters.csv", rig, params)
    how = in_words(recording, motion, section)
    rest, frames = moving_parts(face, params)
    about = {"character": rig.name, "clip": file.stem, "frames_per_second": FRAMES_PER_SECOND, "landmarks": how}
    data, _ = animated_glb(rest, frames, about, TOLERANCE_MM)
    (out / f"{STEM}.glb").write_bytes(data)
    chosen = telling_frames(motion.targets, FRAMES)
    off = np.linalg.norm((frames[0][:, rig.control_points] - motion.targets)[..., :2], axis=-1)
    figure, words = strip(settings.character, face, params, motion, chosen, f"{how} On average a landmark of the mesh "
                          f"ends {off.mean():.2f} mm from where it shall go.")  # fmt: skip
    save_figure(figure, out / f"{STEM}.png", words, LARGEST_BYTES, dither=True)
    return {"frames": len(params), "scale": motion.scale, "landmark_error_mm": float(off.mean()), "in_words": how}


def write_params(file: Path, rig: Rig, params: Float[np.ndarray, "t m"]) -> None:
    """Write rig parameters as `make export PARAMS=` reads them: a control a column, a frame of 1/24 s a line."""
    columns = [Column(control.name, "finite number") for control in rig.controls]
    write_csv(file, columns, [[round(float(value), 6) for value in frame] for frame in params])


def in_words(recording: Recording, motion: Motion, section: CaptureConfig) -> str:
    """Return what was recorded and how it was taken over, in sentences."""
    unit = f"mm per {'pixel' if recording.unit == 'px' else 'mm'}"
    why = "the ratio of the faces' sizes" if section.scale == "face" else "no scale"
    window = section.smoothing_frames
    smooth = f"smoothed over {window} frames" if window > 1 else "not smoothed"
    head = " The head's shift, turn and size in the picture are taken out." if section.head == "steady" else ""
    rate = f" {section.frames_per_second:g} frames a second become {FRAMES_PER_SECOND}."
    return (
        f"{recording.in_words()}, {smooth}; scale {motion.scale:.3g} {unit} ({why}); neutral expression: the first "
        f"{section.neutral_frames} frames.{head}{rate if section.frames_per_second != FRAMES_PER_SECOND else ''}"
    )


def strip(
    character: str,
    face: Rig,
    params: Float[np.ndarray, "t m"],
    motion: Motion,
    chosen: list[int],
    how: str,
    renderer: str | None = None,
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): some frames, the landmarks above and the driven face below."""
    width = cell_width(len(chosen))
    height = round(TALL * width)
    camera, window = head_camera(face, width / height), window_of(motion.recorded, 1.0)
    cells = []
    for k in chosen:
        drawn = landmark_picture(motion.recorded[k], face.control_point_names, window, width, width)
        cells.append(Cell(f"frame {k}", (drawn, face_picture(face, params[k], camera, width, height, renderer))))
    frames = ", ".join(map(str, chosen))
    return face_sheet(cells, len(chosen)), Words(
        f"{len(chosen)} frames of a recording: landmarks of the actor's face as points and lines, and below them "
        f"{character} in clay with the same expression. Frames {frames}.",
        f"Landmarks drive {character} (after Fig. 12): IK networks give rig parameters, the refined networks the mesh. "
        f"{how}",
    )
