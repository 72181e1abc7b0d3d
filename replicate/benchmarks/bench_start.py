"""What a method needs before it can pose: the size of its model, and a fresh process's seconds and memory.

`make bench-start` makes what is missing of the methods. Then it starts new processes, each of which loads one model,
poses one face by one way and says what that took (`first_pose`). The first of them find no machine code and compile
their own; where they have kept some, as they do in the cache by default, others come after them and find it.
"""

import sys
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from replicate.base.progress import progress
from replicate.benchmarks.common import (
    PROFILE,
    add_methods,
    answer,
    artefacts_of,
    bench_methods,
    make_parser,
    placing_attachments,
)
from replicate.benchmarks.first_pose import first_pose
from replicate.config import Config
from replicate.inference.fast_evaluation import fast_evaluation
from replicate.methods import artefacts
from replicate.methods.method_registry import choose
from replicate.methods.plan import Plan
from replicate.report.results import Row, find
from replicate.report.tables import Table, round_off
from replicate.timing.onnx_evaluation import onnx_bytes
from replicate.timing.single_poses import BACKENDS, FAST, ONNX, in_table_order, label_of, parted

ABOUT = "seconds and memory of a fresh process until its first pose, by method and way to evaluate it"
WRITES = "results/runs/bench/bench_start.csv"
TABLE = "bench_start"
FRESH = 2  # processes that are started of each way; the quicker counts
KEPT = "_kept"  # ends the metrics of processes that find the machine code of an earlier one


def measure(config: Config, words: Sequence[str]) -> list[Row]:
    """Make what is missing of one character's methods, let fresh processes pose it once, and return the rows."""
    plan = Plan(config)
    methods = [method for method in choose(words, config) if method.model]
    shared = [stage(plan) for stage in (artefacts.rig_stage, artefacts.samples_stage, artefacts.rigid_stage)]
    inputs = artefacts_of(TABLE, config, [*shared, *(stage for method in methods for stage in method.stages(plan))])
    pose = np.asarray(artefacts.load_samples(inputs).test_params[0], np.float32).tolist()
    mesh, attachments = artefacts.load_mesh(inputs), artefacts.load_attachments(inputs)
    folders = {name: str(Path(folder).absolute()) for name, folder in inputs.items()}
    numbers = []
    with tempfile.TemporaryDirectory() as scratch, progress(len(methods), "fresh processes") as bar:
        for method in methods:
            model, placing = method.model(inputs), placing_attachments(method, attachments)
            asked = {"method": method.name, "inputs": folders}
            numbers.append((method.name, "model_size", "MB", model.size_mb(), None))
            ways = {"": asked} | ({FAST: asked} if fast_evaluation(model, mesh, placing) else {})
            if written := onnx_bytes(model, mesh, placing):
                file = Path(scratch) / f"{method.name}.onnx"
                file.write_bytes(written)
                ways[ONNX] = {"file": str(file)}
            for ending, what in ways.items():
                empty = [Path(scratch) / f"{method.name}{ending}-{number}" for number in range(FRESH)]
                numbers += _numbers(method.name + ending, "", [first_pose(ending, pose, what, one) for one in empty])
                if list(empty[-1].rglob("*.code")):
                    later = [first_pose(ending, pose, what, empty[-1]) for _ in range(FRESH)]
                    numbers += _numbers(method.name + ending, KEPT, later)
            bar.update(1)
    return [
        Row(TABLE, plan.character, name, metric, unit, float(value), None, 1, count, PROFILE, plan.character)
        for name, metric, unit, value, count in numbers
    ]


def _numbers(name: str, kind: str, runs: Sequence[dict]) -> list[tuple]:
    """Return (name, metric, unit, value, processes) of the quickest of some processes; kind: "" or KEPT."""
    best = min(runs, key=lambda one: one["seconds"])
    numbers = [(name, f"first_pose{kind}", "s", best["seconds"], len(runs))]
    if best["peak_mb"] is not None:
        numbers.append((name, f"peak_memory{kind}", "MB", best["peak_mb"], len(runs)))
    return numbers


def start_table(rows: Sequence[Row], character: str) -> Table:
    """Return what one character's methods need until the first pose, by way."""
    body = []
    for name in in_table_order({row.method for row in rows if row.character == character}):
        method, ending = parted(name)
        size = find(rows, TABLE, character, method, "model_size")
        for kind, words in (("", BACKENDS[ending]), (KEPT, f"{BACKENDS[ending]}, code kept")):
            seconds, peak = (find(rows, TABLE, character, name, f"{of}{kind}") for of in ("first_pose", "peak_memory"))
            if seconds or not kind:
                cells = _cell(size, "MB"), _cell(seconds, "s"), _cell(peak, "MB")
                body.append((label_of(method), words, *cells))
    notes = (
        "First pose: from the first import of a fresh process until a face is posed; libraries and the model are "
        f"loaded meanwhile. The quicker of {FRESH} processes, which find all files in the system's memory.",
        "Peak memory: all that the process has had resident, libraries too. ONNX Runtime loads the file that leaves "
        "the suite; torch and the fast evaluation load a trained model by torch.",
        "The fast evaluation compiles its kernels then. Their code is kept in the cache for later processes.",
    )
    header = ("", "", "model, MB", "first pose, s", "peak memory, MB")
    return Table(f"Until the first pose: {character}", (header,), tuple(body), notes, text_columns=2)


def _cell(row: Row | None, unit: str) -> str:
    if row is None:
        return "–"
    return f"{row.value:.1f}" if unit == "s" else round_off(row.value, unit)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark from the command line; return the exit code."""
    parser = make_parser(TABLE, "Time fresh processes until their first pose.", profile="whose trainings are timed")
    add_methods(parser, "table3")
    return answer(parser, partial(bench_methods, TABLE, measure, start_table), arguments)


if __name__ == "__main__":
    sys.exit(main())
