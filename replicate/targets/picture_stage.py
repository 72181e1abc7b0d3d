"""The settings of stages that draw figures."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Picture:
    """Whose figure is drawn, and the seed that decides its examples."""

    character: str
    seed: int
