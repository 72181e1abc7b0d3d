"""What the stage that writes models depends on."""

from dataclasses import dataclass


@dataclass(frozen=True)
class DeployedMethod:
    """A method whose model is written. model: "module:function" of the function that reads it."""

    name: str
    title: str
    model: str
    rigid_step: bool


@dataclass(frozen=True)
class DeploySettings:
    """Whose models are written, the profile of their training, and the seed that poses to check are drawn with."""

    character: str
    profile: str
    seed: int
    methods: tuple[DeployedMethod, ...]
