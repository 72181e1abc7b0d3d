"""The settings of Table 1's stage: what its rows are labelled with, and the shapes of the networks."""

from dataclasses import dataclass

from replicate.approximation.model_size import MapShape


@dataclass(frozen=True)
class SizeNumbers:
    """What the rows are labelled with, and the shapes of the networks whose sizes they hold."""

    character: str
    profile: str
    coarse: MapShape
    refined: MapShape
