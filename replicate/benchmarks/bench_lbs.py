"""Our SSDR and Dem Bones on the same poses: errors on held-out poses, time, memory.

`make bench-lbs` draws training poses (Eq. 5) and test poses of a character for each seed, fits both methods until they
have converged by one rule, refits both to the test poses in the same way (`ssdr.refit`), and measures. Fits run one
after the other, each in a new process on one thread, and are timed by the processor, which other work on the machine
changes little. Finished fits are kept: the same command goes on from there.
"""

import argparse
import json
import math
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

from replicate.base.exceptions import RunError
from replicate.benchmarks import lbs_fits
from replicate.benchmarks.common import (
    add_count,
    answer,
    bench_folder,
    bench_row,
    in_groups,
    make_parser,
    merge,
    note,
    split_names,
)
from replicate.benchmarks.dem_bones import solver_class
from replicate.engine.workers import thread_limits
from replicate.methods.artefacts import rig_identifier, rig_of
from replicate.report.publication import alone
from replicate.report.results import Row, over_seeds, read_results
from replicate.report.tables import Table, as_text, round_off

# The fits as a table: means over seeds, and ours over theirs.

METHODS = {
    "ssdr": "ours", "ssdr_sparse": "ours, sparse from the start",
    "dem_bones": "Dem Bones", "dem_bones_default": "Dem Bones, as it comes",
}  # fmt: skip
EQUAL = 30  # iterations at which times are compared
COLUMNS = {
    "rmse": "RMSE, mm", "mean": "mean, mm", "normal": "normal, °", "max": "max, mm", "time": "time, s",
    "time_at_equal_iterations": f"{EQUAL} iterations, s", "time_to_dem_bones_error": "to equal error, s",
    "peak_memory": "memory, MB", "iterations": "iterations",
}  # fmt: skip
USUAL = (1_000, 200)  # training and test poses
METRIC = re.compile(r"(\w+)\[(\d+)(?:, seed (\d+))?(?:, (\d+) training and (\d+) test poses)?\]")
RATIO = "ratio"  # in the place of a method: ours over Dem Bones'


def metric_of(name: str, bones: int, seed: int, poses: tuple[int, int] = USUAL) -> str:
    """Return what a fit's number is called: "rmse[16, seed 0]"; unusual counts of poses are named too.

    poses: how many training poses and test poses there are.
    """
    training, test = poses
    counts = "" if poses == USUAL else f", {training} training and {test} test poses"
    return f"{name}[{bones}, seed {seed}{counts}]"


def lbs_table(
    rows: Sequence[Row], character: str, poses: tuple[int, int] = USUAL, columns: Collection[str] = tuple(COLUMNS)
) -> Table:
    """Return one character's table: each method's means over seeds, and ours over Dem Bones' with its spread.

    poses: the table shows fits with so many training and test poses. columns: what it shows, keys of `COLUMNS`.
    """
    rows = [row for row in rows if row.character == character and _poses(row.metric) == poses]
    by_seed = _by_seed(rows)
    runs = [[*of_seed, *_ratios(of_seed)] for of_seed in by_seed.values()]
    by_metric = {(row.method, row.metric): row for row in over_seeds(runs)}
    lines, partly = [], False
    for bones in sorted({_place(metric)[1] for _, metric in by_metric}):
        seeds = sum(any(_place(row.metric)[1] == bones for row in run) for run in runs)
        for method, words in (METHODS | {RATIO: "ours / Dem Bones"}).items():
            cells = [by_metric.get((method, f"{name}[{bones}]")) for name in columns]
            if (first := cells[0]) is None:
                continue
            fewer = f" ({first.seeds} of {seeds} seeds)" if first.seeds < seeds else ""
            lines.append((bones, (f"{words}, {bones} bones{fewer}", *(_cell(row, first.seeds) for row in cells))))
            partly |= any(row.seeds < first.seeds for row in cells if row)
    several = f"means over {len(runs)} seeds of poses; ratios ± their standard deviation"
    notes = (
        f"Held-out poses, bones refitted to each alike; {several if len(runs) > 1 else 'one seed of poses'}. "
        "To equal error: until the training error is no larger than Dem Bones'. Times are the processor's, one thread, "
        "with all that comes before the first iteration."
        + (" In brackets: over so many seeds only; in the others it wasn't reached, or not measured." if partly else "")
        + _note_on_starts(rows),
    )
    return Table(f"LBS: {character}", (("", *(COLUMNS[name] for name in columns)),), in_groups(lines), notes)


def _place(metric: str) -> tuple[str, int, int | None]:
    """Return the name, the number of bones and the seed of a metric, "rmse[16, seed 0]"; None if it has no seed."""
    name, bones, seed, *_ = METRIC.fullmatch(metric).groups()
    return name, int(bones), None if seed is None else int(seed)


def _poses(metric: str) -> tuple[int, int]:
    training, test = METRIC.fullmatch(metric).groups()[3:]
    return (int(training), int(test)) if training else USUAL


def _by_seed(rows: Sequence[Row]) -> dict[int, list[Row]]:
    """Return the rows by seed, with metrics that no longer name it."""
    by_seed: dict[int, list[Row]] = {}
    for row in rows:
        name, bones, seed = _place(row.metric)
        by_seed.setdefault(seed, []).append(replace(row, metric=f"{name}[{bones}]"))
    return by_seed


def _ratios(rows: Sequence[Row]) -> list[Row]:
    """Return ours over Dem Bones', for each metric that both have."""
    ours, theirs = ({row.metric: row for row in rows if row.method == method} for method in ("ssdr", "dem_bones"))
    both = ours.keys() & theirs.keys()
    return [replace(ours[m], method=RATIO, unit="ratio", value=ours[m].value / theirs[m].value) for m in sorted(both)]


def _note_on_starts(rows: Sequence[Row]) -> str:
    """Return a sentence on fits for which Dem Bones found too few bones, or nothing."""
    theirs = [row for row in rows if row.method == "dem_bones"]
    starts = [(_place(row.metric)[1], int(row.value)) for row in theirs if row.metric.startswith("bones_of_own_start")]
    few = sorted({(bones, found) for bones, found in starts if found < bones})
    if not few:
        return ""
    counts = ", ".join(f"{found} of {bones}" for bones, found in few)
    return f" Dem Bones' own start found too few bones ({counts}): it got our clusters, which its memory includes."


def _cell(row: Row | None, seeds: int) -> str:
    """Return a value as it is shown, with the count of its seeds in brackets if other values of its line have more."""
    if row is None:
        return "–"
    value = row.value / 1e3 if row.unit == "ms" else row.value
    if row.unit in ("mm", "deg", "ratio"):
        text = round_off(value, row.unit, row.sd if row.unit == "ratio" else None)
    else:
        text = f"{value:.1f}" if row.unit == "ms" and value < 100 else f"{value:,.0f}"
    return f"{text} ({row.seeds})" if row.seeds < seeds else text


ABOUT = "our SSDR beside Dem Bones (pip install py-dem-bones) on the same poses"
WRITES = "results/runs/bench/bench_lbs.csv"
TABLE = "bench_lbs"
BONES, SEEDS = (16, 24, 32), (0, 1, 2)
METRICS = {
    "rmse": "mm", "mean": "mm", "normal": "deg", "max": "mm", "training_rmse": "mm", "iterations": "count",
    "time": "ms", "time_at_equal_iterations": "ms", "time_to_dem_bones_error": "ms", "peak_memory": "MB",
    "bones_of_own_start": "count",
}  # fmt: skip


def rows_of_character(character: str, options: argparse.Namespace, file: Path) -> list[Row]:
    """Run the fits of a character that the file lacks, by method, bones and seed; return all rows of the character."""
    rig, run, poses = rig_of(character), rig_identifier(character), (options.training, options.test)
    for seed in options.seeds:
        with tempfile.TemporaryDirectory(prefix="bench-lbs-") as name:
            folder, missing = Path(name), _missing(file, rig.name, run, seed, options)
            if missing:
                lbs_fits.write_poses(rig, seed, *poses, folder / "poses.npz")
            for bones, method in missing:
                print(f"{rig.name}, {bones} bones, seed {seed}: {METHODS[method]} …", file=sys.stderr, flush=True)
                command = [sys.executable, "-m", lbs_fits.__name__, str(folder), method, str(bones), str(seed)]
                if subprocess.run(command, check=False, env=os.environ | thread_limits(1)).returncode:
                    raise RunError(f"{METHODS[method]}, {bones} bones, seed {seed}: the fit failed; see above")
                results = json.loads((folder / f"{method}.json").read_text())
                if method == "dem_bones":
                    peer_error = min(results["rmse_course"])
                else:
                    peer_error = _peer_error(file, rig.name, run, bones, seed, poses)
                _keep(file, rows_of(rig.name, method, bones, seed, run, results, peer_error, poses))
    return [row for row in read_results(file) if row.character == rig.name]


def _missing(file: Path, character: str, run: str, seed: int, options: argparse.Namespace) -> list[tuple[int, str]]:
    """Return (bones, method) of the fits that the file lacks for this rig, seed and poses, the peers' first."""
    entries = {(row.method, row.metric) for row in _read_rows(file) if (row.character, row.run) == (character, run)}
    methods = sorted(options.methods, key=lambda method: method in lbs_fits.OURS)  # ours is timed against theirs
    poses = options.training, options.test
    return [(b, m) for b in options.bones for m in methods if (m, metric_of("rmse", b, seed, poses)) not in entries]


def _peer_error(file: Path, character: str, run: str, bones: int, seed: int, poses: tuple[int, int] = USUAL) -> float:
    """Return the training error that Dem Bones reached; zero, which nothing reaches, if it hasn't been fitted."""
    key = (character, run, "dem_bones", metric_of("training_rmse", bones, seed, poses))
    return next((r.value for r in _read_rows(file) if (r.character, r.run, r.method, r.metric) == key), 0.0)


def _read_rows(file: Path) -> list[Row]:
    return read_results(file) if file.is_file() else []


def _keep(file: Path, rows: Sequence[Row]) -> None:
    """Write rows to the file in place of those about the same things; rows of another rig of that name go."""
    runs = {(row.character, row.run) for row in rows}
    names = {character for character, _ in runs}
    with alone(file.parent):
        merge(file, rows, lambda row: row.character not in names or (row.character, row.run) in runs)


def rows_of(
    character: str,
    method: str,
    bones: int,
    seed: int,
    run: str,
    results: dict,
    peer_error: float,
    poses: tuple[int, int] = USUAL,
) -> list[Row]:
    """Return one fit's numbers as rows; times in ms.

    character, method, bones, seed: the fit.
    run: identifier of the rig, for the rows' column.
    results: what `lbs_fits.one_fit` has written.
    peer_error: Dem Bones' training RMSE, mm.
    poses: how many training poses and test poses there are.
    """
    course = lbs_fits.Course(results["seconds"], results["rmse_course"])
    values = {
        name: results[name] for name in ("rmse", "mean", "normal", "max", "bones_of_own_start") if name in results
    }
    values |= {
        "training_rmse": min(course.rmse),
        "iterations": len(course.rmse) - 1,
        "time": 1e3 * course.seconds[-1],
        "time_at_equal_iterations": 1e3 * course.seconds[min(EQUAL, len(course.seconds) - 1)],
        "peak_memory": results["peak_mb"],
    }
    seconds = course.time_to(peer_error)
    if math.isfinite(seconds):
        values["time_to_dem_bones_error"] = 1e3 * seconds
    return [
        bench_row(TABLE, character, method, metric_of(name, bones, seed, poses), METRICS[name], value, poses[1], run)
        for name, value in values.items()
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark from the command line; return the exit code."""
    parser = make_parser(TABLE, __doc__, "teen, dragon")
    add_count(parser, "bones", BONES, "numbers of bones")
    add_count(parser, "seeds", SEEDS, "seeds of the poses", least=0)
    parser.add_argument("--methods", nargs="+", default=tuple(METHODS), choices=METHODS, help="default: all")
    add_count(parser, "training", USUAL[0], "training poses")
    add_count(parser, "test", USUAL[1], "held-out poses")
    return answer(parser, _run, arguments)


def _run(options: argparse.Namespace, command_line: Sequence[str]) -> None:

    if any(method not in lbs_fits.OURS for method in options.methods):
        solver_class()
    for character in split_names(options.characters, "for vertices in new poses"):
        rows = rows_of_character(character, options, bench_folder() / f"{TABLE}.csv")
        print(as_text(lbs_table(rows, rows[0].character, (options.training, options.test))) + "\n")
        note(TABLE, [rows[0].character], command_line, options.seeds)


if __name__ == "__main__":
    sys.exit(main())
