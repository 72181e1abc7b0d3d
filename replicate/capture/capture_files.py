"""What `make capture` writes of a recording: parameters, an animated GLB, and a strip of frames (§5.3.2)."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, UInt8

from data_recipes.rig import Rig
from replicate.base.tables import Column, write_csv
from replicate.capture import landmark_rig
from replicate.capture.capture_config import CaptureConfig, CaptureSettings
from replicate.capture.driven_face import ApproximatedRig, driven_params, face_picture, head_camera
from replicate.capture.landmark_file import Recording, read_landmarks
from replicate.capture.landmark_motion import Motion, control_motion, telling_frames
from replicate.drawing.face_sheet import Cell, cell_width, face_sheet
from replicate.drawing.panels import DPI, Words, save_figure
from replicate.export.animation import FRAMES_PER_SECOND, animated_glb
from replicate.export.files import moving_parts
from replicate.methods.measurement import predictor

if TYPE_CHECKING:
    import matplotlib.figure


STEM = "capture"  # of the files' names
FRAMES, TALL = 5, 1.2  # frames of a strip; a picture's height over its width
TOLERANCE_MM = 0.25  # that a vertex of the GLB may be off: less than a landmark is


def write_all(settings: CaptureSettings, inputs: Mapping[str, Path], file: Path, out: Path) -> dict:
    """Write a recording's files into the folder `out` and return facts about it. file: the recording, as CSV."""
    rig, section = landmark_rig.load_landmark_rig(inputs), settings.section
    recording = read_landmarks(file, rig.control_point_names, section.longest_gap)
    motion = control_motion(recording, rig.mesh.neutral[rig.control_points], section)
    params = driven_params(landmark_rig.load_networks(inputs, settings.method.method), motion.targets, rig)
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
    save_figure(figure, out / f"{STEM}.png", words)
    return {"frames": len(params), "scale": motion.scale, "landmark_error_mm": float(off.mean()), "in_words": how}


def write_params(file: Path, rig: Rig, params: Float[np.ndarray, "t m"]) -> None:
    """Write rig parameters as `make export PARAMS=` reads them: one column a control, one line a frame of 1/24 s."""
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
    character: str, face: Rig, params: Float[np.ndarray, "t m"], motion: Motion, chosen: list[int], how: str
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): some frames, the landmarks above and the driven face below.

    character: its name
    face: the character with the approximation's skin
    params: raw rig parameters of all frames
    motion: the landmarks of all frames
    chosen: which frames are shown
    how: a sentence on how the landmarks were taken over
    """
    width = cell_width(len(chosen))
    height = round(TALL * width)
    camera, window = head_camera(face, width / height), window_of(motion.recorded, 1.0)
    cells = []
    for k in chosen:
        drawn = landmark_picture(motion.recorded[k], face.control_point_names, window, width, width)
        cells.append(Cell(f"frame {k}", (drawn, face_picture(face, params[k], camera, width, height))))
    frames = ", ".join(map(str, chosen))
    return face_sheet(cells, len(chosen)), Words(
        f"{len(chosen)} frames of a recording: landmarks of the actor's face as points and lines, and below them "
        f"{character} in clay with the same expression. Frames {frames}.",
        f"Landmarks drive {character} (after Fig. 12): IK networks give rig parameters, our regional method the mesh. "
        f"{how}",
    )


# Landmarks as a picture: points, with the lines of brows, eyes, nose and mouth through them.

RED, GREY = "#d62728", "#8a8a8a"
MARGIN = 0.12  # around the landmarks, as a share of their height
CHAINS = (  # beginnings of names whose landmarks a line joins in their order; True: back to the first one
    ("chin_", False),
    ("brow_right", False),
    ("brow_left", False),
    ("nose_bridge", False),
    ("below nose", False),
    ("eye_right", True),
    ("eye_left", True),
    ("outer lip", True),
    ("seam", True),
)


def landmark_picture(
    places: Float[np.ndarray, "l 2"],
    names: Sequence[str],
    window: tuple[Float[np.ndarray, " 2"], Float[np.ndarray, " 2"]],
    width: int,
    height: int,
) -> UInt8[np.ndarray, "h w 3"]:
    """Return a picture of one frame's landmarks.

    places: of the landmarks, y up
    names: of the landmarks, which say how lines join them
    window: lower left and upper right corner of what is shown
    width, height: of the picture, pixels
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure((width / DPI, height / DPI), dpi=DPI, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    for chain, closed in CHAINS:
        joined = [k for k, name in enumerate(names) if _belongs(name, chain)]
        joined = joined + joined[:1] if closed else joined
        axes.plot(*places[joined].T, color=GREY, linewidth=width / 160, solid_joinstyle="round")
    axes.plot(*places.T, "o", color=RED, markersize=width / 55, markeredgewidth=0)
    (left, bottom), (right, top) = window
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def window_of(places: Float[np.ndarray, "t l 2"], aspect: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of a window that shows the landmarks of all frames. aspect: its width over its height."""
    low, high = places.min(axis=(0, 1)), places.max(axis=(0, 1))
    tall = (1 + 2 * MARGIN) * max(high[1] - low[1], (high[0] - low[0]) / aspect)
    half = np.array([aspect * tall, tall]) / 2
    return (low + high) / 2 - half, (low + high) / 2 + half


def _belongs(name: str, chain: str) -> bool:
    if chain == "outer lip":
        return name.startswith(("lip_", "mouth_"))
    if chain == "below nose":
        return name.startswith(("nose_wing", "nostril", "nose_base"))
    if chain == "nose_bridge":
        return name.startswith(("nose_bridge", "nose_tip"))
    return name.startswith(chain) or (chain == "chin_" and name == "chin")
