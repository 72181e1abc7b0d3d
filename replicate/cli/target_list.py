"""The list of targets in `replicate/targets/targets.toml`; a target's module is loaded only when it is needed."""

import argparse
import ast
import importlib
import re
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import ModuleType

from replicate.base.paths import ROOT
from replicate.cli.options import OF_A_RUN
from replicate.engine.stage import Stage
from replicate.report.results import cast
from replicate.report.tables import Table

FILE = ROOT / "replicate" / "targets" / "targets.toml"
DEFAULT_CHARACTER = "teen"


@dataclass(frozen=True)
class Target:
    """A target of `make`; `targets.toml` explains its fields. module: the module that holds it, by default its name."""

    name: str
    group: str
    about: str
    writes: str
    options: tuple[str, ...] = ("run",)
    whole_cast: bool = False
    methods: tuple[str, ...] = ()
    in_comparison: bool = False
    asks_the_rig: str = ""
    takes_trained: bool = False
    module: str = ""

    def characters(self) -> tuple[str, ...]:
        """Return the characters that it is made for if none is named."""
        return cast() if self.whole_cast else (DEFAULT_CHARACTER,)

    def run(self, options: argparse.Namespace) -> None:
        """Make the target."""
        self._module().run(options)

    @property
    def stages(self) -> Callable[..., Sequence[Stage]] | None:
        """The function (plan, methods) → the stages of one character, its result last; None for targets without any."""
        return getattr(self._module(), "stages", None)

    def _module(self) -> ModuleType:
        return importlib.import_module(self.module or f"replicate.targets.{self.name.replace('-', '_')}")


@cache
def targets() -> dict[str, Target]:
    """Return all targets by name, in the order of the help."""
    return {name: _target(name, entry) for name, entry in tomllib.loads(FILE.read_text(encoding="utf-8")).items()}


def _target(name: str, entry: dict) -> Target:
    entry = {key: tuple(value) if isinstance(value, list) else value for key, value in entry.items()}
    options = entry.pop("options", ("run",))
    spelled_out = tuple(name for option in options for name in (OF_A_RUN if option == "run" else (option,)))
    return Target(name, options=spelled_out, **entry)


def target_table() -> Table:
    """Return the table of everything that `make` makes: targets, benchmarks, and the Makefile's rules."""
    lines = [(name, target.about, target.writes) for name, target in targets().items()]
    lines += [_benchmark_line(file) for file in sorted((ROOT / "replicate" / "benchmarks").glob("bench_*.py"))]
    rules = (ROOT / "Makefile").read_text(encoding="utf-8")
    lines += [(name, about, "") for name, about in re.findall(r"^([a-z-]+):.*?## (.*)$", rules, re.MULTILINE)]
    body = tuple((f"`make {name}`", about, f"`{where}`" if "/" in where else where) for name, about, where in lines)
    return Table("What make makes", (("target", "what it makes", "where"),), body, text_columns=3)


def _benchmark_line(file: Path) -> tuple[str, str, str]:
    """Return the name of a benchmark's target, what it is about and what it writes, as its module says."""
    constants = {
        node.targets[0].id: ast.literal_eval(node.value)
        for node in ast.parse(file.read_text(encoding="utf-8")).body
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") in ("ABOUT", "WRITES")
    }
    return file.stem.replace("_", "-"), constants["ABOUT"], constants["WRITES"]
