"""The settings of the stage "capture"."""

from dataclasses import dataclass

from replicate.capture.capture_config import CaptureConfig
from replicate.methods.measurement import MeasurementNumbers


@dataclass(frozen=True)
class CaptureNumbers:
    """Whose face is driven, how landmarks are taken over, and what approximation gives the mesh."""

    character: str
    section: CaptureConfig
    method: MeasurementNumbers
