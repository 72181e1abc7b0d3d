"""On which rigs would the claims hold? Table 2's errors on rigs of one head, from an easy one to a hard one.

`make bench-ladder` goes up a character's ladder (`data_recipes/README.md`): the same head and controls, with more
deformers at each step. Then come uniform poses in the place of its animation, and the whole rig once more: with the
face in one chart, as in the paper; with whole clips of the animation held out for the test, not frames; and with these
clips, trained on the animation as it is, without the factors of Eq. 5. On each it trains the paper's networks, the
straight line and our method for a part of the profile's steps, and measures them on the test poses as Table 2 does.
Nothing is chosen by these numbers. Trainings go through the cache like any stage, so that a stopped run goes on.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace

from data_recipes.recipe_paths import split_character
from replicate.artefacts.plan import Plan
from replicate.benchmarks.common import (
    add_count,
    add_only,
    answer,
    artefacts_of,
    bench_folder,
    make_parser,
    publish,
    selected,
    split_names,
)
from replicate.benchmarks.ladder_tables import CLIPS, RAW, RUNGS, TABLE, ladder_tables
from replicate.config import Config, resolve
from replicate.engine import paths
from replicate.engine.exceptions import InputError
from replicate.methods import measurement
from replicate.methods.method_registry import choose, sections
from replicate.report.error_rows import error_rows
from replicate.report.results import Row, read_results
from replicate.report.tables import as_text

ABOUT = "on which rigs the claims would hold: Table 2's errors from an easy rig of a head to a hard one"
WRITES = "results/runs/bench/bench_ladder.csv, bench_ladder_<character>.png"
PART = 5
METHODS = ("coarse", "refined", "dense", "lbs32", "regional", "linear", "neutral")
TRAINED = ("coarse", "refinement", "dense", "regional")  # sections of the configuration with a training
SHOWN = ("vertex_error_mean", "vertex_error_p95", "normal_error_mean", "normal_error_p95")


def rung_config(head: str, rung: str, profile: str, part: int) -> Config:
    """Return the configuration of one rig, whose networks train for one `part`-th of the profile's steps."""
    character, samples = f"{head}@{rung}", {}
    if rung in (CLIPS, RAW):
        character, samples = head, {"split": "clips"} | ({"low": 1.0, "high": 1.0} if rung == RAW else {})
    own = sections(profile)
    usual = resolve(character, profile, sections=own)
    short = {name: {"training": {"steps": max(1, getattr(usual, name).training.steps // part)}} for name in TRAINED}
    return resolve(character, profile, short | {"samples": samples}, sections=own)


def measure(head: str, rung: str, profile: str, part: int, methods: Sequence[str]) -> list[Row]:
    """Train and measure some methods on one rig, and return its rows of the table, whose character is <head>@<rung>."""
    config = rung_config(head, rung, profile, part)
    plan = Plan(config)
    stages = [measurement.stage(plan, method) for method in choose(methods, config)]
    folders = measurement.error_folders(artefacts_of(TABLE, config, stages))
    errors = {name: measurement.load_errors(folder) for name, folder in folders.items()}
    rows = error_rows(plan.character, errors, profile, TABLE.replace("_", "-"))
    shown = [row for row in rows if row.table == "table2" and row.metric in SHOWN]
    return [replace(row, table=TABLE, character=f"{head}@{rung}") for row in shown]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the comparison from the command line; return the exit code."""
    parser = make_parser(TABLE, __doc__, profile="whose samples and numbers")
    parser.add_argument("--rungs", default=",".join(RUNGS), help=f"which rigs of the head (default: {','.join(RUNGS)})")
    add_only(parser)
    add_count(parser, "part", PART, "a training takes so many times fewer steps than the profile's")
    return answer(parser, _run, arguments)


def _run(options: argparse.Namespace, command_line: Sequence[str]) -> None:
    from replicate.benchmarks.ladder_figure import ladder_figure
    from replicate.drawing.panels import save_figure

    rungs = options.rungs.replace(",", " ").split()
    if not rungs or set(rungs) - set(RUNGS):
        raise InputError(f"rungs are {options.rungs!r}: allowed are {', '.join(RUNGS)}")
    methods = selected(METHODS, options.only)
    for head in split_names(options.characters):
        if split_character(head)[1]:
            raise InputError(f"character {head!r} is one rig of a ladder: name its head, {split_character(head)[0]!r}")
        for rung in rungs:
            rows = measure(head, rung, options.profile, options.part, methods)
            publish(TABLE, rows, [], command_line, in_part=bool(options.only))
        rows = read_results(bench_folder() / f"{TABLE}.csv")  # those of earlier calls too
        for table in ladder_tables(rows, head):
            print(as_text(table))
        file = bench_folder() / f"{TABLE}_{head}.png"
        figure, words = ladder_figure(rows, head)
        save_figure(figure, file, words)
        print(f"written to {paths.display_path(file.parent)}: {file.name}")


if __name__ == "__main__":
    sys.exit(main())
