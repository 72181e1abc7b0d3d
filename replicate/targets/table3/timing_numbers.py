"""The settings of Table 3's stage."""

from dataclasses import dataclass

from replicate.methods.measurement import MeasurementNumbers


@dataclass(frozen=True)
class TimingNumbers:
    """Whose table it is, what is timed, and how often.

    models: by method's name "module:function" of its model, of those that have one. measured: when the measurement was
    asked for; a time is no fact that a later run could take over.
    """

    character: str
    profile: str
    seed: int
    methods: tuple[MeasurementNumbers, ...]
    models: tuple[tuple[str, str], ...]
    turns: int
    measured: str
