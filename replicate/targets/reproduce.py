"""Make all results of the repository anew from the commit that is checked out, a command after the other.

Which commands is `reproduce.toml` beside this file. A run that is stopped goes on where it was: what is done at this
commit is noted, and what a command has trained so far is in the cache.
"""

import argparse
import importlib.util
import json
import os
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from replicate.base import paths
from replicate.base.exceptions import InputError, RunError
from replicate.base.files import write_text
from replicate.base.schema import Checked, number, read_table
from replicate.cli.options import configurations, methods
from replicate.cli.parser import parser
from replicate.cli.running import duration, known_times, times_s, wall_s
from replicate.cli.target_list import targets
from replicate.engine.cache_report import UP_TO_DATE, states
from replicate.engine.provenance import core_count, git_state
from replicate.engine.stage import Stage, in_order
from replicate.methods.plan import Plan

FILE = Path(__file__).with_suffix(".toml")
DONE = "reproduced.json"  # in results/runs: the commit at which each command was done
BENCH = "bench_"
PUBLISH = ("make reference", "make reference PROFILE=paper", "REPLICATE_RESULTS=results/runs/clips make reference")


@dataclass(frozen=True)
class Step(Checked):
    """A command behind the committed results; `reproduce.toml` explains its fields."""

    command: str = ""
    minutes: float = number(0.0, 0.0, 1e4)
    results: str = ""
    needs: str = ""

    def words(self) -> list[str]:
        """Return the words of the process that makes it."""
        name, *rest = shlex.split(self.command)
        where = [f"replicate.benchmarks.{name}"] if name.startswith(BENCH) else ["replicate", name]
        return [sys.executable, "-m", *where, *rest]

    def missing(self) -> str:
        """Return the first thing that it needs and this machine lacks, or ""."""
        for need in self.needs.split():
            if not (os.environ.get(need) or shutil.which(need) or importlib.util.find_spec(need)):
                return need
        return ""


def run(options: argparse.Namespace) -> None:
    """Say what is to be done and about how long it takes; without `details`, do it."""
    state = git_state()
    if state is None or not state["clean"]:
        raise InputError("results come from a commit alone: commit your changes first, or check a commit out")
    commit, steps = state["commit"], read_steps()
    todo = [step for step in steps if _done().get(step.command) != commit and not step.missing()]
    print(_plan(steps, todo, commit))
    for place, step in enumerate(() if options.details else todo, 1):
        print(f"\n{place} of {len(todo)}: {step.command}", flush=True)
        folder = {paths.RESULTS_VARIABLE: str(_runs() / step.results)} if step.results else {}
        if code := subprocess.run(step.words(), env=os.environ | folder, cwd=paths.ROOT).returncode:
            raise RunError(f"{step.command}: exit code {code}; `make reproduce` goes on there")
        write_text(_runs() / DONE, json.dumps(_done() | {step.command: commit}, indent=1) + "\n")
    if not options.details:
        print(
            f"\nall results of {commit[:7]} are in {paths.display_path(_runs())}; these put them in the place of the "
        )
        print(f"committed ones: {', '.join(f'`{command}`' for command in PUBLISH)}")


def read_steps() -> list[Step]:
    """Return the commands in their order."""
    return [read_table(Step(), entry) for entry in tomllib.loads(FILE.read_text(encoding="utf-8"))["steps"]]


def _runs() -> Path:
    return paths.run_folder("laptop").parent


def _done() -> dict[str, str]:
    with suppress(OSError, ValueError):
        return dict(json.loads((_runs() / DONE).read_text(encoding="utf-8")))
    return {}


def _plan(steps: Sequence[Step], todo: Sequence[Step], commit: str) -> str:
    """Return a line for each command: done, left out, or about how long it takes beyond those before it."""
    lines, seconds, seen = [], 0.0, set()
    for step in steps:
        if step.missing():
            lines.append(f"  left out    {step.command} ({step.missing()} is missing)")
        elif step not in todo:
            lines.append(f"  done        {step.command}")
        else:
            own = 60 * step.minutes + _training_s(step, seen)
            seconds += own
            lines.append(f"  {duration(own):11} {step.command}")
    total = (
        f"{len(todo)} of {len(steps)} commands to do at {commit[:7]}, about {duration(seconds)} on {core_count()} cores"
    )
    return "\n".join([total if todo else f"all {len(steps)} commands are done at {commit[:7]}", *lines])


def _training_s(step: Step, seen: set[str]) -> float:
    """Return the seconds of a command's stages that neither the cache nor an earlier command has; these join `seen`."""
    every = states(stages_of(step))
    missing = [stage for stage, state in every if state != UP_TO_DATE and stage.identifier not in seen]
    seen |= {stage.identifier for stage in missing}
    return wall_s(missing, times_s(missing, known_times(paths.REFERENCE)), core_count())


def stages_of(step: Step) -> list[Stage]:
    """Return all stages of a command, inputs first; none for a benchmark, or where the characters are not there yet."""
    words = shlex.split(step.command)
    target = targets().get(words[0])
    if not (target and target.stages and "characters" in target.options):
        return []
    options, found = parser().parse_args(words), []
    with suppress(InputError):
        for config in configurations(options):
            rows = methods(options, config) if "methods" in target.options else ()
            found += target.stages(Plan(config), rows)
    return in_order(found)
