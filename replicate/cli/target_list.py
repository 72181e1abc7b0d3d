"""The list of targets, as `replicate/targets/targets.toml` has it; a target's module is loaded when it is asked for."""

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
    """A target of `make`; `targets.toml` says what its fields mean. module: which holds it, else that of its name."""

    name: str
    group: str
    about: str
    writes: str
    options: tuple[str, ...] = ("run",)
    whole_cast: bool = False
    methods: tuple[str, ...] = ()
    in_comparison: bool = False
    asks_the_rig: str = ""
    module: str = ""

    def characters(self) -> tuple[str, ...]:
        """Return the characters that it takes if none is named."""
        return cast() if self.whole_cast else (DEFAULT_CHARACTER,)

    def run(self, options: argparse.Namespace) -> None:
        """Do what the target is for."""
        self._module().run(options)

    @property
    def stages(self) -> Callable[..., Sequence[Stage]] | None:
        """Return the function (plan, methods) → its graph for one character, its result last; None without a graph."""
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
    spelled_out = tuple(one for option in options for one in (OF_A_RUN if option == "run" else (option,)))
    return Target(name, options=spelled_out, **entry)


def target_table() -> Table:
    """Return a line for each thing that `make` makes: targets, benchmarks, and make's own."""
    lines = [(name, target.about, target.writes) for name, target in targets().items()]
    lines += [_benchmark_line(file) for file in sorted((ROOT / "replicate" / "benchmarks").glob("bench_*.py"))]
    rules = (ROOT / "Makefile").read_text(encoding="utf-8")
    lines += [(name, about, "") for name, about in re.findall(r"^([a-z-]+):.*?## (.*)$", rules, re.MULTILINE)]
    body = tuple((f"`make {name}`", about, f"`{where}`" if "/" in where else where) for name, about, where in lines)
    return Table("What make makes", (("target", "what it makes", "where"),), body, text_columns=3)


def _benchmark_line(file: Path) -> tuple[str, str, str]:
    """Return the name of a benchmark's target, what its module says that it is about, and what it writes."""
    constants = {
        node.targets[0].id: ast.literal_eval(node.value)
        for node in ast.parse(file.read_text(encoding="utf-8")).body
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") in ("ABOUT", "WRITES")
    }
    return file.stem.replace("_", "-"), constants["ABOUT"], constants["WRITES"]
