"""The settings of Table 3's stages."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from replicate.methods.measurement import MeasurementNumbers


@dataclass(frozen=True)
class RigNumbers:
    """Whose rows they are, what is timed, and how often.

    models: by method's name "module:function" of its model, of those that have one. sources: the names of the stages
    that it is read from, each with its title. file: where the rows are written.
    """

    character: str
    profile: str
    methods: tuple[MeasurementNumbers, ...]
    models: tuple[tuple[str, str], ...]
    turns: int
    sources: tuple[tuple[str, str], ...]
    file: str

    def own(self, inputs: Mapping[str, Path]) -> dict[str, Path]:
        """Return those of some artefacts, by their stages' titles, that are this rig's, by their stages' names."""
        return {name: inputs[title] for name, title in self.sources}


@dataclass(frozen=True)
class TimingNumbers:
    """The rigs that are timed together, and when that was asked for: no later run can take over a time."""

    rigs: tuple[RigNumbers, ...]
    measured: str


@dataclass(frozen=True)
class RowsNumbers:
    """Which file of the measurement has a rig's rows."""

    file: str
