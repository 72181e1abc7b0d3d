"""The settings of Figure 12's stage."""

from dataclasses import dataclass

from replicate.capture.capture_config import CaptureConfig
from replicate.inverse.ik_config import InverseConfig
from replicate.methods.measurement import MeasurementNumbers


@dataclass(frozen=True)
class ThroughMethod:
    """A method that IK networks are trained through: how it predicts, and "module:function" of its model."""

    measured: MeasurementNumbers
    model: str

    @property
    def name(self) -> str:
        """The method's name."""
        return self.measured.method


@dataclass(frozen=True)
class CaptureTrial:
    """Whose face is driven, by whose performances (its own first), and through what."""

    character: str
    actors: tuple[str, ...]
    profile: str
    seed: int
    section: CaptureConfig
    inverse: InverseConfig
    methods: tuple[ThroughMethod, ...]

    @property
    def noises_mm(self) -> tuple[float, ...]:
        """The standard deviations of what is added to each coordinate of the actors' landmarks, rising."""
        return tuple(sorted(set(self.section.noises_mm)))
