"""The settings of Figure 11's stage."""

from dataclasses import dataclass

from replicate.methods.measurement import MeasurementNumbers


@dataclass(frozen=True)
class PosedPicture:
    """Whose figure it is, and what is shown beside the rig; the IK networks are trained through the first."""

    character: str
    methods: tuple[MeasurementNumbers, ...]
