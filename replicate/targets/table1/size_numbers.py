"""The settings of Table 1's stage: what its rows are labelled with, and the shapes of the networks."""

from dataclasses import dataclass


@dataclass(frozen=True)
class MapShape:
    """The shape of a map network, for its size: what `approximation.model_size` needs of a network's section."""

    map_size: int
    channels: int
    hidden: tuple[int, ...]


@dataclass(frozen=True)
class SizeNumbers:
    """What the rows are labelled with, and the shapes of the networks whose sizes they hold."""

    character: str
    profile: str
    coarse: MapShape
    refined: MapShape
