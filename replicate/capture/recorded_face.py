"""What a recording must show before it drives a character (§5.3.2): a face that has a size and stands upright."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from replicate.capture.capture_config import CaptureConfig
from replicate.capture.landmark_file import MM, Recording
from replicate.capture.landmark_motion import face_size
from replicate.engine.exceptions import InputError

POINT = 1e-6  # a face of this size, as a share of its largest coordinate, is a point


def check_face(recording: Recording, names: Sequence[str], section: CaptureConfig) -> None:
    """Raise InputError for landmarks in one place where a face's size counts, and for a face that isn't upright.

    recording: one that `check_recording` accepts. names: of the landmarks, as `FACE_LANDMARKS` has them. A face is
    upright in the neutral frames if the line from its chin to its brows is nearer to up, and that from its right to its
    left nearer to the picture's right, than to any other axis.
    """
    rest = recording.positions[: section.neutral_frames].mean(axis=0)
    if _is_point(rest):
        if section.scale == "face" or section.head == "steady":
            raise InputError("all landmarks of the neutral frames are in one place, where a face is allowed")
        return
    points = (
        [k for k, places in enumerate(recording.positions) if _is_point(places)] if section.head == "steady" else []
    )
    if points:
        raise InputError(
            f"all landmarks of frame {points[0]}, counted from 0, are in one place, where a face is allowed ([capture] "
            "head is 'steady')"
        )
    fault = _turned(rest, names, "y points up in mm" if recording.unit == MM else "y points down in pixels")
    if fault:
        raise InputError(f"in the neutral frames {fault}")


def _is_point(places: Float[np.ndarray, "l 2"]) -> bool:
    return face_size(places) <= POINT * float(np.abs(places).max())


def _turned(rest: Float[np.ndarray, "l 2"], names: Sequence[str], rule: str) -> str:
    """Return what is wrong with how a face stands and what mends it; "" for nothing. rule: where y points."""
    up = _middle(rest, names, "brow") - _middle(rest, names, "chin")
    across = _middle(rest, names, "left") - _middle(rest, names, "right")
    if abs(up[0]) >= abs(up[1]) or abs(across[1]) >= abs(across[0]):
        return (
            f"the face lies on its side, where an upright one is allowed: x points to the picture's right and {rule}; "
            "perhaps x and y have changed places"
        )
    if up[1] < 0:
        return f"the brows are below the chin, where above it is allowed: {rule}; turn the sign of y"
    if across[0] < 0:
        return (
            "the face's left has the smaller x, where the larger one is allowed: x points to the picture's right, the "
            "face's own left; turn the sign of x"
        )
    return ""


def _middle(rest: Float[np.ndarray, "l 2"], names: Sequence[str], part: str) -> Float[np.ndarray, " 2"]:
    return rest[[part in name for name in names]].mean(axis=0)
