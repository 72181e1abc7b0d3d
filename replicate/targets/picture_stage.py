"""What the stages that draw figures have in common."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Picture:
    """Whose figure is drawn, and the seed that examples are chosen with."""

    character: str
    seed: int
