"""What `make capture` writes of a recording: parameters, an animated GLB, and a strip of frames (§5.3.2)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float32, UInt8

from data_recipes.catalogue import play_weights
from data_recipes.rig import Rig
from replicate.base.tables import Column, write_csv
from replicate.capture import landmark_rig
from replicate.capture.capture_config import CaptureConfig, CaptureSettings
from replicate.capture.driven_face import ApproximatedRig, driven_params, face_picture, head_camera
from replicate.capture.landmark_file import MM, Recording
from replicate.capture.landmark_motion import Motion, control_motion, resampled, telling_frames
from replicate.capture.tracker_files import Weights, read_recording
from replicate.drawing.face_sheet import Cell, cell_width, face_sheet
from replicate.drawing.marks import balls_in_front
from replicate.drawing.panels import DPI, Words, as_picture, save_figure
from replicate.export.animation import FRAMES_PER_SECOND, animated_glb
from replicate.export.files import moving_parts
from replicate.methods import artefacts
from replicate.methods.measurement import predictor

if TYPE_CHECKING:
    import matplotlib.figure


STEM = "capture"  # of the files' names
FRAMES, TALL = 5, 1.2  # frames of a strip; a picture's height over its width
BALL_MM = 1.2  # the radius of a landmark in a picture of the face
TOLERANCE_MM = 0.25  # that a vertex of the GLB may be off: less than a landmark is


@dataclass(frozen=True)
class Driven:
    """What a recording makes a character do, 24 frames a second.

    rig: the character. params: (t, m). motion: of its landmarks, None where weights drive its controls. how: in
    sentences. means: what drives it, a sentence's beginning. lacking: a sentence on weights without a counterpart, "".
    """

    rig: Rig
    params: np.ndarray
    motion: Motion | None
    how: str
    means: str
    lacking: str = ""


def write_all(settings: CaptureSettings, inputs: Mapping[str, Path], file: Path, out: Path) -> dict:
    """Write a recording's files into the folder `out` and return facts about it. file: the recording."""
    driven = drive(settings, inputs, read_recording(file, settings.section))
    rig, params, motion = driven.rig, driven.params, driven.motion
    face = ApproximatedRig(rig, predictor(settings.method, inputs))
    write_params(out / f"{STEM}_parameters.csv", rig, params)
    rest, frames = moving_parts(face, params)
    about = {
        "character": rig.name,
        "clip": file.stem,
        "frames_per_second": FRAMES_PER_SECOND,
        "landmarks": driven.how,
    }
    data, _ = animated_glb(rest, frames, about, TOLERANCE_MM)
    (out / f"{STEM}.glb").write_bytes(data)
    places, off, ends = frames[0][:, rig.landmarks], {}, ""
    if motion is not None:
        places = motion.targets
        error_mm = float(np.linalg.norm((frames[0][:, rig.control_points] - places)[..., :2], axis=-1).mean())
        off = {"scale": motion.scale, "landmark_error_mm": error_mm}
        ends = f" On average a landmark of the mesh ends {error_mm:.2f} mm from where it shall go."
    figure, words = strip(settings.character, face, driven, telling_frames(places, FRAMES), driven.how + ends)
    save_figure(figure, out / f"{STEM}.png", words)
    return {"frames": len(params), **off, "in_words": f"{driven.how}{ends}", "lacking": driven.lacking}


def drive(settings: CaptureSettings, inputs: Mapping[str, Path], recording: Recording | Weights) -> Driven:
    """Return what a recording makes the character do: by its landmarks, or by weights of controls that it has."""
    section = settings.section
    if isinstance(recording, Recording):
        rig = landmark_rig.load_landmark_rig(inputs)
        motion = control_motion(recording, rig.mesh.neutral[rig.control_points], section)
        return _driven_by_landmarks(settings, inputs, rig, motion, in_words(recording, motion, section))
    values = resampled(recording.values, recording.frames_per_second)
    rate = recording.frames_per_second
    become = "" if rate == FRAMES_PER_SECOND else f"; {rate:g} frames a second become {FRAMES_PER_SECOND}"
    if not settings.actor:
        rig = artefacts.load_rig(inputs)
        params, lacking = play_weights(recording.names, values, rig.controls)
        how = f"{recording.in_words()}{become}. They drive the controls of {settings.character} by their names."
        sentence = _lacking(settings.character, [*lacking, *recording.head])
        return Driven(rig, params.astype(np.float32), None, how, "Weights by name drive", sentence)
    actor, rig = (landmark_rig.load_landmark_rig(inputs, name) for name in (settings.actor, settings.character))
    acted, lacking = play_weights(recording.names, values, actor.controls)
    motion = motion_of_rig(actor, acted.astype(np.float32), rig.mesh.neutral[rig.control_points], section)
    how = (
        f"{recording.in_words()}{become}. {settings.actor} plays them, and its {len(rig.control_points)} landmarks "
        f"drive {settings.character}; scale {motion.scale:.3g}."
    )
    driven = _driven_by_landmarks(settings, inputs, rig, motion, how)
    return replace(driven, lacking=_lacking(settings.actor, [*lacking, *recording.head]))


def _driven_by_landmarks(
    settings: CaptureSettings, inputs: Mapping[str, Path], rig: Rig, motion: Motion, how: str
) -> Driven:
    params = driven_params(landmark_rig.load_networks(inputs, settings.method.method), motion.targets, rig)
    return Driven(rig, params, motion, how, "Landmarks drive")


def _lacking(character: str, names: Sequence[str]) -> str:
    return f"Without a counterpart in {character}: {', '.join(names)}." if names else ""


def motion_of_rig(
    actor: Rig, params: Float32[np.ndarray, "t m"], neutral: Float[np.ndarray, "l 3"], section: CaptureConfig
) -> Motion:
    """Return where a character's landmarks go when those of another rig do what its parameters say.

    actor: a rig whose control points are its landmarks
    params: its parameters, 24 frames a second
    neutral: the character's landmarks in its neutral pose, mm
    section: says whether the movement is scaled; nothing is smoothed, since a rig's landmarks have no noise
    """
    rest = actor.mesh.neutral[actor.control_points, :2].astype(float)
    places = actor(params)[:, actor.control_points, :2].astype(float)
    count = section.neutral_frames
    recording = Recording(np.concatenate([np.tile(rest, (count, 1, 1)), places]), MM, 0, float(FRAMES_PER_SECOND))
    motion = control_motion(recording, neutral, replace(section, smoothing_frames=1, head="moving"))
    return Motion(motion.targets[count:], motion.scale, motion.recorded[count:])


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
    frames = recording.frames_per_second or section.frames_per_second
    rate = f" {frames:g} frames a second become {FRAMES_PER_SECOND}." if frames != FRAMES_PER_SECOND else ""
    return (
        f"{recording.in_words()}, {smooth}; scale {motion.scale:.3g} {unit} ({why}); neutral expression: the first "
        f"{section.neutral_frames} frames.{head}{rate}"
    )


def strip(
    character: str, face: Rig, driven: Driven, chosen: list[int], how: str
) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): some frames of the driven face, its landmarks above if these drive it.

    character: its name
    face: the character with the approximation's skin
    driven: what it does, and why
    chosen: which frames are shown
    how: sentences on how the recording was taken over
    """
    width = cell_width(len(chosen))
    height = round(TALL * width)
    camera, motion = head_camera(face, width / height), driven.motion
    cells = []
    for k in chosen:
        marks = None
        if motion is not None:
            vertices = face(driven.params[k])
            marks = balls_in_front(vertices[face.control_points], vertices, BALL_MM)
        pictures = [face_picture(face, driven.params[k], camera, width, height, marks)]
        if motion is not None:
            window = window_of(motion.recorded, 1.0)
            pictures.insert(0, landmark_picture(motion.recorded[k], face.control_point_names, window, width, width))
        cells.append(Cell(f"frame {k}", tuple(pictures)))
    frames = ", ".join(map(str, chosen))
    above = "" if motion is None else "landmarks of the actor's face as points and lines, and below them "
    what = f"{character} in clay{'' if motion is None else ' with the same expression, its landmarks as points'}"
    networks = "" if motion is None else "IK networks give rig parameters, "
    return face_sheet(cells, len(chosen)), Words(
        f"{len(chosen)} frames of a recording: {above}{what}. Frames {frames}.",
        f"{driven.means} {character} (after Fig. 12): {networks}our regional method {'' if networks else 'gives '}the "
        f"mesh. {how}",
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
    from matplotlib.figure import Figure

    figure = Figure((width / DPI, height / DPI), dpi=DPI, facecolor="white")
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
    return as_picture(figure)


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
