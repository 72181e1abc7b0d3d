"""The list of all that `make` makes, as REPRODUCING has it: targets of the registry, benchmarks, and make's own."""

import ast
import re
from pathlib import Path

from replicate.engine.paths import ROOT
from replicate.report.tables import Table
from replicate.targets.target_registry import targets


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
