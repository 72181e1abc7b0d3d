"""The settings of the stage that writes a character's rig report."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ReportNumbers:
    """Whose report is written, and as rows of which profile."""

    character: str
    profile: str
    seed: int
