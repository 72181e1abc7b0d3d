"""One character's graph of stages while it is put together; every artefact has one stage.

rig ─┬─ samples ──┬─ rigid ─┬─ coarse ──────┬─ refined
     └─ influence ┘         ├─ selection ───┘
                            └─ dense, linear, pca
     samples ── lbs16, lbs24, lbs32 ── driven          each method ── its errors ── the tables that compare methods
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from data_recipes.recipe_paths import character_label
from replicate.config import Config
from replicate.engine.stage import Stage


@dataclass(frozen=True)
class StageSettings:
    """What a stage depends on: a section of the configuration, and the seed it draws from."""

    section: Any
    seed: int


@dataclass(frozen=True)
class TrainingSettings(StageSettings):
    """The same for a stage that trains a network on a device."""

    device: str


class Plan:
    """The stages of one character under one configuration, each of them once.

    character: the character's name as in results.
    """

    def __init__(self, config: Config):
        self.config = config
        self.character = character_label(config.character)
        self._stages: dict[str, Stage] = {}

    def stage(
        self,
        name: str,
        function: Callable | str,
        settings: object,
        *inputs: Stage,
        files: tuple[Path, ...] = (),
        per_seed: bool = True,
    ) -> Stage:
        """Return the stage of that name, which is made when it is first asked for.

        function: called with a `StageContext` in another process; also as "module:function".
        settings: a frozen dataclass of what the result depends on, or None.
        inputs, files: as for `Stage`.
        per_seed: False if nothing depends on the seed, so that all seeds share the artefact.
        """
        if name not in self._stages:
            seed = self.config.seed if per_seed else 0
            label = f"{self.character}-seed{seed}" if seed else self.character
            path = function if isinstance(function, str) else reference(function)
            self._stages[name] = Stage(name, path, settings, inputs, label, files)
        return self._stages[name]

    def __contains__(self, name: str) -> bool:
        return name in self._stages

    def __getitem__(self, name: str) -> Stage:
        return self._stages[name]

    def settings(self, section: object) -> StageSettings:
        """Return a section of the configuration with the plan's seed."""
        return StageSettings(section, self.config.seed)

    def training(self, section: object) -> TrainingSettings:
        """Return a section of the configuration with the plan's seed and device."""
        return TrainingSettings(section, self.config.seed, self.config.device)


def reference(function: Callable | None) -> str:
    """Return "module:function" of a function at the top of its module; raise ValueError for None.

    A function whose first argument is set, `partial(function, "word")`, gives "module:function(word)".
    """
    if function is None:
        raise ValueError("expected a function at the top of a module, got None")
    if isinstance(function, partial):
        (word,) = function.args
        return f"{reference(function.func)}({word})"
    return f"{function.__module__}:{function.__qualname__}"
