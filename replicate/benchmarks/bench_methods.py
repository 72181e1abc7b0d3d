"""How long each method takes for one pose, rigid segments placed, beside the rig itself; one thread.

`make bench-methods` makes what is missing of the methods, then lets rig and methods take turns on the same test poses,
one pose a call, so that a busy machine slows all of them alike; the median of the turns counts. Oracles are left out:
they are handed the answer. It prints milliseconds and how many times as fast as the rig each method is, and writes
bench_methods.csv.
"""

import argparse
import os
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from replicate.artefacts import built_rig, drawn_samples
from replicate.artefacts.plan import Plan
from replicate.benchmarks.common import PROFILE, add_count, answer, artefacts_of, make_parser, publish, split_names
from replicate.config import Config, resolve
from replicate.engine.progress import progress
from replicate.methods import measurement
from replicate.methods.method_registry import choose, in_order, method_named, sections
from replicate.report.results import Row, find
from replicate.report.tables import Table, round_off

ABOUT = "milliseconds a pose of every method beside the rig, one pose at a time, on one thread"
WRITES = "results/runs/bench/bench_methods.csv"
TABLE = "bench_methods"
RIG = "rig"
ROUNDS = 50


def time_ways(ways: dict[str, Callable[[np.ndarray], object]], poses: np.ndarray, rounds: int) -> dict[str, np.ndarray]:
    """Return each way's wall times in ms, (rounds,); each round has one pose of its own, and one goes before them."""
    times = {name: np.zeros(rounds) for name in ways}
    with progress(rounds, "timing") as bar:
        for turn in range(-1, rounds):
            params = poses[turn % len(poses)][None]
            for name, way in ways.items():
                start = time.perf_counter()
                way(params)
                times[name][max(turn, 0)] = 1e3 * (time.perf_counter() - start)
            bar.update(1)
    return times


def measure(config: Config, words: Sequence[str], rounds: int) -> list[Row]:
    """Make what is missing of some methods of one character, time them, and return their rows."""
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --xla_cpu_multi_thread_eigen=false".strip()
    os.environ["NPROC"] = "1"  # the size of XLA's pool; both before JAX is loaded
    plan = Plan(config)
    methods = [method for method in choose(words, config) if not method.oracle]
    stages = [measurement.stage(plan, method) for method in methods]
    inputs = artefacts_of(TABLE, config, stages)
    rig, samples = built_rig.load(inputs), drawn_samples.load(inputs)
    ways: dict[str, Callable] = {RIG: rig}
    for method, stage in zip(methods, stages, strict=True):
        predict = measurement.predictor(stage.config, inputs)
        ways[method.name] = partial(_without_truth, predict)
    with threadpool_limits(1):
        times = time_ways(ways, np.asarray(samples.test_params), rounds)
    rows = []
    for name, milliseconds in times.items():
        numbers = {
            "pose_ms": ("ms", float(np.median(milliseconds))),
            "pose_ms_p95": ("ms", float(np.quantile(milliseconds, 0.95))),
            "times_as_fast": ("ratio", float(np.median(times[RIG]) / np.median(milliseconds))),
        }
        for metric, (unit, value) in numbers.items():
            rows.append(Row(TABLE, plan.character, name, metric, unit, value, None, 1, rounds, PROFILE, plan.character))
    return rows


def _without_truth(predict: Callable, params: np.ndarray) -> np.ndarray:
    return predict(params, np.zeros((len(params), 0, 3), np.float32))


def methods_table(rows: Sequence[Row], character: str) -> Table:
    """Return one character's times, the rig first."""
    names = [RIG, *in_order({row.method for row in rows if row.character == character} - {RIG})]
    body = []
    for name in names:
        cells = [find(rows, TABLE, character, name, metric) for metric in ("pose_ms", "pose_ms_p95", "times_as_fast")]
        label = "The rig, compiled" if name == RIG else method_named(name).label
        body.append((label, *(round_off(cell.value, cell.unit) if cell else "–" for cell in cells)))
    notes = ("One pose a call, on one thread; medians over turns. Rigid segments placed where a method needs it.",)
    header = ("", "ms a pose", "95 % below, ms", "times as fast as the rig")
    return Table(f"Milliseconds a pose: {character}", (header,), tuple(body), notes)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark from the command line; return the exit code."""
    parser = make_parser(TABLE, "Time every method for one pose.", profile="whose trainings are timed")
    parser.add_argument("--config", help="a TOML file with numbers of your own, as for table2")
    parser.add_argument("--methods", nargs="+", default=["all"], help="as for table2 (default: all)")
    add_count(parser, "rounds", ROUNDS, "poses that each is timed on")
    return answer(parser, _run, arguments)


def _run(options: argparse.Namespace, command_line: Sequence[str]) -> None:
    words = split_names(" ".join(options.methods))
    choose(words)
    file = Path(options.config) if options.config else None
    for character in split_names(options.characters):
        config = resolve(character, options.profile, file=file, sections=sections(options.profile))
        rows = measure(config, words, options.rounds)
        publish(TABLE, rows, [methods_table(rows, rows[0].character)], command_line)


if __name__ == "__main__":
    sys.exit(main())
