"""The list of targets: every module or folder here that says what it is about and how it runs."""

import argparse
import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

PACKAGE = "replicate.targets"


@dataclass(frozen=True)
class Target:
    """A target of `make`, which is a command of `python -m replicate` too; the module of its name, with _ for -, holds
    all of it.

    about: what it makes, for lists. writes: where. options: those of `options.OPTIONS` that it takes. characters: those
    that it takes if none is named; methods: likewise, None for the standard ones. run: does it. stages: (plan, methods)
    → its graph for one character, its result last; None for a target without one. in_comparison: whether `make compare`
    shows its CSV. asks_the_rig: what for it evaluates rigs at poses of its own, which a rig that is known by its
    samples can't bear; "" if it doesn't.
    """

    name: str
    about: str
    writes: str
    options: tuple[str, ...]
    characters: Callable[[], tuple[str, ...]]
    methods: tuple[str, ...] | None
    run: Callable[[argparse.Namespace], None]
    stages: Callable | None
    in_comparison: bool
    asks_the_rig: str


def one_character() -> tuple[str, ...]:
    """Return the character that a target takes if none is named."""
    return ("teen",)


@cache
def targets() -> dict[str, Target]:
    """Return all targets by name, tables first."""
    registry = {}
    for _, name, _ in pkgutil.iter_modules(importlib.import_module(PACKAGE).__path__):
        module = importlib.import_module(f"{PACKAGE}.{name}")
        if hasattr(module, "ABOUT"):
            command = name.replace("_", "-")
            registry[command] = Target(
                command,
                module.ABOUT,
                module.WRITES,
                module.OPTIONS,
                getattr(module, "CHARACTERS", one_character),
                getattr(module, "METHODS", None),
                module.run,
                getattr(module, "stages", None),
                getattr(module, "IN_COMPARISON", False),
                getattr(module, "ASKS_THE_RIG", ""),
            )
    return dict(sorted(registry.items(), key=lambda item: (item[1].stages is None, not item[1].in_comparison, item[0])))
