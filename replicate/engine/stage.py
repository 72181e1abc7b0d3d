"""A stage: a function that makes an artefact from a configuration and from the artefacts of other stages."""

import hashlib
import importlib
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from replicate.base.code_hash import sources_digest
from replicate.base.exceptions import InputError
from replicate.base.progress import Progress, progress
from replicate.base.schema import to_json


@dataclass(frozen=True, eq=False)
class Stage:
    """One node of the graph; its key alone decides whether its artefact is up to date.

    name: short and lower-case, such as "coarse".
    function: "module:function", called with a `StageContext` in a separate process; functions that it calls by a
        computed name follow after commas, so that their sources count too.
    config: a frozen dataclass of numbers, text, tuples and dataclasses; it has a `seed` if the stage draws.
    inputs: the stages whose artefacts it reads.
    label: whose stage it is, such as the character; part of the folder's name.
    files: data files whose content it depends on, such as a recipe.
    threads: how many it may use; 0 for as many as there are workers, and then it runs alone.
    """

    name: str
    function: str
    config: object
    inputs: tuple["Stage", ...] = ()
    label: str = ""
    files: tuple[Path, ...] = ()
    threads: int = 1

    def __post_init__(self):
        if not re.fullmatch(r"[\w.@-]+", self.title):
            raise ValueError(f"stage {self.title!r}: names and labels name folders; use letters, digits, _, . and -")

    @property
    def title(self) -> str:
        """The name and the label, as progress and logs show them."""
        return f"{self.name}-{self.label}" if self.label else self.name

    @cached_property
    def key(self) -> str:
        """A hash of the name, the configuration, the inputs' keys, the sources and the data files."""
        parts = {
            "name": self.name,
            "config": to_json(self.config),
            "inputs": [stage.key for stage in self.inputs],
            "sources": sources_digest(self.function),
            "draws": sources_digest(f"{__name__}:stream_rng"),
            "files": [_file_digest(Path(file)) for file in self.files],
        }
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]

    @property
    def identifier(self) -> str:
        """The name of the artefact's folder in the cache."""
        return f"{self.title}-{self.key}"


def _file_digest(file: Path) -> str:
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError as error:
        raise InputError(f"{file} can't be read ({error.strerror})") from error


@dataclass(frozen=True)
class StageContext:
    """The argument of a stage's function.

    name, config, files: those of the stage.
    inputs: the folders of the input stages' verified artefacts by name; by title, name-label, where names are equal.
    out: an empty folder to fill.
    scratch: a folder for checkpoints, which outlives a kill and is removed when the artefact is complete.
    threads: how many the stage may use.
    notes: facts for the artefact's manifest.
    """

    name: str
    config: Any
    inputs: Mapping[str, Path]
    out: Path
    scratch: Path
    threads: int = 1
    files: tuple[Path, ...] = ()
    notes: dict = field(default_factory=dict)

    def progress(self, total: float, label: str, initial: float = 0) -> Progress:
        """Return a context manager whose `.update(k)` reports `total` steps, of which `initial` were done before."""
        return progress(total, label, initial)

    def note(self, **facts: object) -> None:
        """Put facts (JSON-ready) into the artefact's manifest."""
        self.notes.update(json.loads(json.dumps(facts)))

    def rng(self, stream: str) -> np.random.Generator:
        """Return the generator of a named stream; it depends on the seed, the stage's name and the stream alone."""
        return stream_rng(self.config.seed, self.name, stream)


def stream_rng(seed: int, name: str, stream: str) -> np.random.Generator:
    """Return the generator of a stage's named stream; streams don't disturb each other."""
    digest = hashlib.sha256(json.dumps([seed, name, stream]).encode()).digest()
    return np.random.default_rng(int.from_bytes(digest[:16], "little"))


def stage_function(function: str) -> Callable[..., Any]:
    """Import and return the function "module:function", the first of several; "(word)" behind it is its argument."""
    module, _, call = function.split(",")[0].partition(":")
    name, _, word = call.rstrip(")").partition("(")
    found = getattr(importlib.import_module(module), name)
    return partial(found, word) if word else found


def input_names(stages: tuple[Stage, ...]) -> dict[str, Stage]:
    """Return the stages by the names under which a function finds them in `context.inputs`."""
    names = [stage.name for stage in stages]
    titles = {stage.title: stage for stage in stages}
    if len(titles) < len(stages):
        raise ValueError(f"two inputs have the same title: {', '.join(stage.title for stage in stages)}")
    return titles | {stage.name: stage for stage in stages if names.count(stage.name) == 1}


def in_order(stages: list[Stage]) -> list[Stage]:
    """Return the stages and all that they need, each once, inputs first, otherwise in the order given."""
    order: dict[str, Stage] = {}

    def visit(stage: Stage) -> None:
        if stage.identifier not in order:
            for source in stage.inputs:
                visit(source)
            order[stage.identifier] = stage

    for stage in stages:
        visit(stage)
    return list(order.values())
