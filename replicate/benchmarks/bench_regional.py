"""What each piece of our regional method does: one is taken away, or changed, at a time.

`make bench-regional` trains the method at a short schedule as it is, and with one thing changed, and compares the
errors on the validation poses, which are held out of the training animation; test poses are not looked at. Trainings go
through the cache like any stage, so that a stopped run goes on.
"""

import argparse
import sys
from collections.abc import Sequence

from replicate.artefacts.plan import Plan
from replicate.benchmarks.common import answer, check_at_least, make_parser, publish, split_names
from replicate.config import resolve
from replicate.engine.provenance import core_count, provenance
from replicate.engine.scheduler import run
from replicate.engine.store import artefact_folder, read_manifest
from replicate.methods import regional
from replicate.methods.method_registry import sections
from replicate.methods.training_stage import LOG
from replicate.report.results import Row
from replicate.report.tables import Table, as_text, round_off
from replicate.report.training_curves import read_log

ABOUT = "what each piece of our regional method does to its errors and its size"
WRITES = "results/runs/bench/bench_regional.csv"
TABLE = "bench_regional"
STEPS = 4_000
CHANGES = {
    "as it is": {},
    "no straight line": {"line": False},
    "leaky ReLUs, no products": {"gated": False},
    "squared errors": {"squares": True},
    "balanced draws": {"training": {"draws": "balanced"}},
    "components of positions alone": {"normal_weight": 0.0},
    "one region, as many bytes": {"regions": 1},
    "64 regions": {"regions": 64, "components": 48, "fine": 8},
    "64 components": {"components": 64},
    "hidden layers of 256": {"hidden": [256, 256]},
    "hidden layers of 768": {"hidden": [768, 768]},
    "all components in 16 bits": {"fine": 4_096},
}
METRICS = {
    "model_size": "MB",
    "multiplications": "count",
    "validation_vertex_error": "mm",
    "validation_normal_error": "deg",
}


def compare(character: str, profile: str, steps: int) -> list[Row]:
    """Train all variants of one character and return their sizes and validation errors."""
    own = sections(profile)
    training = {"steps": steps}
    configs = [
        resolve(
            character,
            profile,
            {"regional": change | {"training": training | change.get("training", {})}},
            sections=own,
        )
        for change in CHANGES.values()
    ]
    stages = [regional.stage(Plan(config)) for config in configs]
    run(stages, facts=provenance(["make", "bench-regional"], profile, [0], core_count()))
    rows = []
    for change, config, stage in zip(CHANGES, configs, stages, strict=True):
        folder = artefact_folder(stage.identifier)
        notes = read_manifest(folder)["notes"]
        *_, last = read_log(folder / LOG)
        values = (notes["size_mb"], notes["multiplications"], last[2], last[3])
        facts = (None, 1, config.samples.validation, profile, "bench-regional")
        for (metric, unit), value in zip(METRICS.items(), values, strict=True):
            rows.append(Row(TABLE, stage.label, "regional", f"{metric}[{change}]", unit, float(value), *facts))
    return rows


def pieces_table(rows: Sequence[Row]) -> list[Table]:
    """Return a table for each character in `bench_regional.csv`."""
    tables = []
    for character in dict.fromkeys(row.character for row in rows if row.table == TABLE):
        values = {row.metric: row for row in rows if row.table == TABLE and row.character == character}
        lines = []
        for change in CHANGES:
            cells = [values.get(f"{metric}[{change}]") for metric in METRICS]
            if all(cells):
                size, products, mm, degrees = cells
                million = f"{products.value / 1e6:.1f}"
                ends = (round_off(mm.value, mm.unit), round_off(degrees.value, degrees.unit))
                lines.append((change, f"{size.value:.1f}", million, *ends))
        poses = max(row.poses or 0 for row in values.values())
        note = f"errors on {poses} poses held out of the training animation; one seed; a short schedule."
        header = ("", "MB", "million products", "mm", "degrees")
        tables.append(Table(f"Pieces of the regional method: {character}", (header,), tuple(lines), (note,)))
    return tables


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the comparison from the command line; return the exit code."""
    parser = make_parser("bench_regional", __doc__, profile="whose numbers are changed")
    parser.add_argument("--steps", type=int, default=STEPS, help=f"of each training (default: {STEPS})")
    return answer(parser, _run, arguments)


def _run(options: argparse.Namespace, command_line: Sequence[str]) -> None:
    check_at_least(1, steps=options.steps)
    rows = [row for name in split_names(options.characters) for row in compare(name, options.profile, options.steps)]
    for table in pieces_table(rows):
        print(as_text(table))
    publish("bench_regional", rows, command_line)


if __name__ == "__main__":
    sys.exit(main())
