"""The settings of Table 2's stage: what its rows are labelled with."""

from dataclasses import dataclass


@dataclass(frozen=True)
class TableNumbers:
    """What the rows are labelled with."""

    character: str
    profile: str
    seed: int
