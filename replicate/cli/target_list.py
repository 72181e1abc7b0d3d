"""The list of targets: every module or folder of `replicate/targets` that says what it is about and how it runs."""

import argparse
import ast
import importlib
import pkgutil
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from replicate.base.paths import ROOT
from replicate.report.tables import Table

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


# The list of all that `make` makes, as REPRODUCING has it: targets of the registry, benchmarks, and make's own.


def target_table() -> Table:
    """Return a line for each target: its name, what it makes, and where."""
    lines = [(name, target.about, target.writes) for name, target in targets().items()]
    lines += [benchmark_line(file) for file in sorted((ROOT / "replicate" / "benchmarks").glob("bench_*.py"))]
    rules = (ROOT / "Makefile").read_text(encoding="utf-8")
    lines += [(name, about, "") for name, about in re.findall(r"^([a-z-]+):.*?## (.*)$", rules, re.MULTILINE)]
    body = tuple((f"`make {name}`", about, f"`{where}`" if "/" in where else where) for name, about, where in lines)
    return Table("What make makes", (("target", "what it makes", "where"),), body, text_columns=3)


def benchmark_line(file: Path) -> tuple[str, str, str]:
    """Return the name of a benchmark's target, what its module says that it is about, and what it writes."""
    constants = {
        node.targets[0].id: ast.literal_eval(node.value)
        for node in ast.parse(file.read_text(encoding="utf-8")).body
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") in ("ABOUT", "WRITES")
    }
    return file.stem.replace("_", "-"), constants["ABOUT"], constants["WRITES"]
