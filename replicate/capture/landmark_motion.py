"""From an actor's landmarks to a character's control points: c = c⁰ + l − l⁰ (§5.3.2), scaled and smoothed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.signal
from jaxtyping import Float, Float32

from replicate.base.exceptions import InputError
from replicate.capture.capture_config import DEGREE, CaptureConfig
from replicate.capture.landmark_file import MM, PIXELS, Recording

FRAMES_PER_SECOND = 24.0  # of all clips


@dataclass(frozen=True)
class Motion:
    """Where a character's landmarks are wanted. targets: (t, l, 3) mm, with z of the neutral pose.

    scale: what the actor's movement was multiplied with, mm per unit of the recording. recorded: (t, l, 2) the actor's
    landmarks, steadied, smoothed and resampled.
    """

    targets: np.ndarray
    scale: float
    recorded: np.ndarray


def control_motion(recording: Recording, neutral: Float[np.ndarray, "l 3"], section: CaptureConfig) -> Motion:
    """Return where a character's landmarks go when an actor's have moved as recorded.

    neutral: c⁰, the character's landmarks in its neutral pose, mm. Raises InputError as `check_recording` does.
    """
    check_recording(recording, section)
    count = section.neutral_frames
    positions = recording.positions
    if section.head == "steady":
        positions = steadied(positions, positions[:count].mean(axis=0))
    rest = positions[:count].mean(axis=0)
    rate = recording.frames_per_second or section.frames_per_second
    positions = resampled(smoothed(positions, section.smoothing_frames), rate)
    scale = face_size(neutral[:, :2]) / face_size(rest) if section.scale == "face" else 1.0
    targets = np.tile(np.asarray(neutral, np.float32), (len(positions), 1, 1))
    targets[..., :2] += scale * (positions - rest)
    return Motion(targets.astype(np.float32), float(scale), positions)


def check_recording(recording: Recording, section: CaptureConfig) -> None:
    """Raise InputError for a recording with no frame beyond the neutral ones, and for pixels taken as millimetres."""
    count = section.neutral_frames
    if len(recording.positions) <= count:
        raise InputError(
            f"the recording: expected more than {count} frames, got {len(recording.positions)}: the first {count} are "
            "taken for the neutral expression ([capture] neutral_frames in a CONFIG file)"
        )
    if recording.unit == PIXELS and section.scale == "none":
        raise InputError("landmarks in pixels need a scale: [capture] scale is 'none', set it to 'face'")


def face_size(places: Float[np.ndarray, "l 2"]) -> float:
    """Return the root mean square distance of landmarks from their middle."""
    return float(np.sqrt(np.square(places - places.mean(axis=0)).sum(axis=1).mean()))


def smoothed(positions: Float[np.ndarray, "t l 2"], frames: int) -> Float[np.ndarray, "t l 2"]:
    """Return landmarks after a Savitzky-Golay filter: a parabola fitted to windows of some frames; 1 for none."""
    if frames == 1:
        return positions
    return scipy.signal.savgol_filter(positions, frames, DEGREE, axis=0, mode="nearest")


def resampled(values: Float[np.ndarray, "t *l"], frames_per_second: float) -> Float[np.ndarray, "u *l"]:
    """Return landmarks or weights at 24 frames a second, interpolated between those of a recording at another rate."""
    if frames_per_second == FRAMES_PER_SECOND:
        return values
    times = np.arange(len(values)) / frames_per_second
    wanted = np.arange(int(times[-1] * FRAMES_PER_SECOND + 1e-9) + 1) / FRAMES_PER_SECOND
    columns = values.reshape(len(values), -1).T
    return np.stack([np.interp(wanted, times, column) for column in columns], 1).reshape(-1, *values.shape[1:])


def steadied(positions: Float[np.ndarray, "t l 2"], rest: Float[np.ndarray, "l 2"]) -> Float[np.ndarray, "t l 2"]:
    """Return landmarks without the head's shift, turn and size in the picture.

    Each frame is brought onto the neutral one by the similarity that fits all landmarks best in least squares; the
    foreshortening of a head that turns aside or nods stays.
    """
    frames, goal = (_complex(each - each.mean(axis=-2, keepdims=True)) for each in (positions, rest))
    turn = (frames.conj() * goal).sum(-1, keepdims=True) / (np.abs(frames) ** 2).sum(-1, keepdims=True)
    moved = turn * frames
    return np.stack([moved.real, moved.imag], -1) + rest.mean(axis=0)


def _complex(places: Float[np.ndarray, "*t l 2"]) -> np.ndarray:
    return places[..., 0] + 1j * places[..., 1]


def jitter_mm(places: Float[np.ndarray, "t l d"]) -> float:
    """Return the mean length of the second difference in time, mm: how much a motion trembles."""
    return float(np.linalg.norm(np.diff(places, 2, axis=0), axis=-1).mean())


def telling_frames(places: Float32[np.ndarray, "t l 3"] | Float[np.ndarray, "t l 3"], count: int) -> list[int]:
    """Return the `count` frames of a motion that differ most from the first frame and from each other, in order."""
    flat = np.asarray(places, float).reshape(len(places), -1)
    away = np.linalg.norm(flat - flat[0], axis=1)
    chosen: list[int] = []
    for _ in range(min(count, len(flat))):
        chosen.append(int(np.argmax(away)))
        away = np.minimum(away, np.linalg.norm(flat - flat[chosen[-1]], axis=1))
    return sorted(chosen)


# What a recording must show before it drives a character (§5.3.2): an upright face that isn't a point.

POINT = 1e-6  # a face of this size, as a share of its largest coordinate, is a point


def check_face(recording: Recording, names: Sequence[str], section: CaptureConfig) -> None:
    """Raise InputError for landmarks in one place where a face's size counts, and for a face that isn't upright.

    recording: one that `check_recording` accepts. names: of the landmarks, as in `FACE_LANDMARKS`. A face is upright in
    the neutral frames if the line from its chin to its brows points up more than sideways, and that from its right to
    its left points to the picture's right more than up or down.
    """
    rest = recording.positions[: section.neutral_frames].mean(axis=0)
    if _is_point(rest):
        if section.scale == "face" or section.head == "steady":
            raise InputError("all landmarks of the neutral frames are in one place, so there is no face")
        return
    points = (
        [k for k, places in enumerate(recording.positions) if _is_point(places)] if section.head == "steady" else []
    )
    if points:
        raise InputError(
            f"all landmarks of frame {points[0]}, counted from 0, are in one place, so there is no face to hold steady "
            "([capture] head is 'steady')"
        )
    fault = _turned(rest, names, "y points up in mm" if recording.unit == MM else "y points down in pixels")
    if fault:
        raise InputError(f"in the neutral frames {fault}")


def _is_point(places: Float[np.ndarray, "l 2"]) -> bool:
    return face_size(places) <= POINT * float(np.abs(places).max())


def _turned(rest: Float[np.ndarray, "l 2"], names: Sequence[str], rule: str) -> str:
    """Return how a face is turned wrongly and what mends it, "" if it is upright. rule: where y points."""
    up = _middle(rest, names, "brow") - _middle(rest, names, "chin")
    across = _middle(rest, names, "left") - _middle(rest, names, "right")
    if abs(up[0]) >= abs(up[1]) or abs(across[1]) >= abs(across[0]):
        return (
            f"the face lies on its side and has to be upright: x points to the picture's right and {rule}; perhaps x "
            "and y have changed places"
        )
    if up[1] < 0:
        return f"the brows are below the chin and have to be above it: {rule}; turn the sign of y"
    if across[0] < 0:
        return (
            "the face's left has the smaller x and has to have the larger one: x points to the picture's right, the "
            "face's own left; turn the sign of x"
        )
    return ""


def _middle(rest: Float[np.ndarray, "l 2"], names: Sequence[str], part: str) -> Float[np.ndarray, " 2"]:
    return rest[[part in name for name in names]].mean(axis=0)
