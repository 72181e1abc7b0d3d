"""The settings of performance capture: how landmarks become control points (§5.3.2)."""

from dataclasses import dataclass
from typing import Literal

from replicate.base.exceptions import InputError
from replicate.base.schema import Checked, number, numbers
from replicate.methods.measurement import MeasurementSettings

DEGREE = 2  # of the polynomials that smoothing fits to a window of frames


@dataclass(frozen=True)
class CaptureConfig(Checked):
    """How the movement of landmarks is taken over, and what Figure 12 tries (DEVIATIONS D26).

    scale: "face" scales the actor's movement by the faces' sizes, "none" takes its millimetres as they are
    head: "steady" takes the head's shift, turn and size in the picture out of each frame, "moving" leaves them in
    neutral_frames: how many first frames show the neutral expression
    smoothing_frames: an odd window, 1 for none
    longest_gap: how many frames in a row are interpolated where a landmark was not seen
    frames_per_second: of the recording, where its file doesn't say
    picture: width and height of the actor's picture, for a file that gives shares of them; () for a square one
    actor: who performs beside the character itself in Figure 12, "" for the woman, or the teen for the woman; in
        `make capture` a face with ARKit's names that weights play on, so that its landmarks drive the character
    noises_mm: standard deviations of the noise in each coordinate of an actor's landmarks, in Figure 12
    """

    scale: Literal["face", "none"] = "face"
    head: Literal["moving", "steady"] = "moving"
    neutral_frames: int = number(3, 1, 10_000)
    smoothing_frames: int = number(7, 1, 999)
    longest_gap: int = number(6, 0, 10_000)
    frames_per_second: float = number(24.0, 1.0, 1_000.0)
    picture: tuple[float, ...] = numbers((), 2, 1.0, 100_000.0, optional=True)
    actor: str = ""
    noises_mm: tuple[float, ...] = number((0.0, 0.25, 0.5, 1.0, 2.0), 0.0, 1_000.0)

    def __post_init__(self):
        super().__post_init__()
        if self.smoothing_frames % 2 == 0 or 1 < self.smoothing_frames <= DEGREE:
            expected = f"1 for no smoothing, or an odd number of frames from {DEGREE + 1}"
            raise InputError(f"smoothing_frames: expected {expected}, got {self.smoothing_frames}")


def default_section(profile: str) -> CaptureConfig:
    """Return the section `[capture]` of a profile's configuration, the same in every profile."""
    return CaptureConfig()


# The settings of the stage "capture".


@dataclass(frozen=True)
class CaptureSettings:
    """Whose face is driven, how landmarks move it, and which approximation gives the mesh.

    actor: who plays a recording of weights, so that its landmarks drive the character; "" where none does.
    """

    character: str
    section: CaptureConfig
    method: MeasurementSettings
    actor: str = ""
