"""What a method needs before it can pose: the size of its model, and a fresh process's seconds and memory.

`make bench-start` trains methods where that is missing. Then it starts new processes, each of which loads one model,
poses one face in one way and reports its time and memory (`first_pose`). The first ones have to compile machine code;
where they have kept it, as they do in the cache by default, other processes then start with it.
"""

import sys
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from data_recipes.recipe_paths import character_label
from replicate.base.progress import progress
from replicate.benchmarks.common import add_methods, answer, bench_methods, bench_row, make_parser, trained_methods
from replicate.benchmarks.first_pose import first_pose
from replicate.config import Config
from replicate.inference.fast_evaluation import fast_evaluation
from replicate.methods import artefacts
from replicate.methods.attachment import placing_attachments
from replicate.report.results import Row, find
from replicate.report.tables import Table, our_value
from replicate.timing.backends import onnx_bytes
from replicate.timing.single_poses import BACKENDS, FAST, ONNX, in_table_order, label_of, parted

ABOUT = "seconds and memory of a fresh process until its first pose, by method and way to evaluate it"
WRITES = "results/runs/bench/bench_start.csv"
TABLE = "bench_start"
FRESH = 2  # processes started for each way, of which the quicker counts
KEPT = "_kept"  # the ending of metrics of processes that find the machine code of an earlier one


def measure(config: Config, words: Sequence[str]) -> list[Row]:
    """Let fresh processes pose one character once with each of its methods, and return the rows."""
    needed = (artefacts.rig_stage, artefacts.samples_stage, artefacts.rigid_stage)
    methods, inputs = trained_methods(TABLE, config, words, *needed)
    pose = np.asarray(artefacts.load_samples(inputs).test_params[0], np.float32).tolist()
    mesh, attachments = artefacts.load_mesh(inputs), artefacts.load_attachments(inputs)
    folders = {name: str(Path(folder).absolute()) for name, folder in inputs.items()}
    measured = []
    with tempfile.TemporaryDirectory() as scratch, progress(len(methods), "fresh processes") as bar:
        for method in methods:
            model, placing = method.model(inputs), placing_attachments(method, attachments)
            trained = {"method": method.name, "inputs": folders}
            measured.append((method.name, "model_size", "MB", model.size_mb(), None))
            ways = {"": trained} | ({FAST: trained} if fast_evaluation(model, mesh, placing) else {})
            if written := onnx_bytes(model, mesh, placing):
                file = Path(scratch) / f"{method.name}.onnx"
                file.write_bytes(written)
                ways[ONNX] = {"file": str(file)}
            for ending, source in ways.items():
                kernels = [Path(scratch) / f"{method.name}{ending}-{k}" for k in range(FRESH)]  # empty folders
                runs = [first_pose(ending, pose, source, folder) for folder in kernels]
                measured += _quickest(method.name + ending, "", runs)
                if list(kernels[-1].rglob("*.code")):
                    runs = [first_pose(ending, pose, source, kernels[-1]) for _ in range(FRESH)]
                    measured += _quickest(method.name + ending, KEPT, runs)
            bar.update(1)
    character = character_label(config.character)
    return [bench_row(TABLE, character, *facts) for facts in measured]


def _quickest(name: str, kind: str, runs: Sequence[dict]) -> list[tuple]:
    """Return (name, metric, unit, value, processes) of the quickest of some processes; kind: "" or KEPT."""
    best = min(runs, key=lambda run: run["seconds"])
    measured = [(name, f"first_pose{kind}", "s", best["seconds"], len(runs))]
    if best["peak_mb"] is not None:
        measured.append((name, f"peak_memory{kind}", "MB", best["peak_mb"], len(runs)))
    return measured


def start_table(rows: Sequence[Row], character: str) -> Table:
    """Return what each way to evaluate one character's methods needs until the first pose."""
    body = []
    for name in in_table_order({row.method for row in rows if row.character == character}):
        method, ending = parted(name)
        size = find(rows, TABLE, character, method, "model_size")
        for kind, words in (("", BACKENDS[ending]), (KEPT, f"{BACKENDS[ending]}, code kept")):
            seconds, peak = (find(rows, TABLE, character, name, f"{of}{kind}") for of in ("first_pose", "peak_memory"))
            if seconds or not kind:
                shown = f"{seconds.value:.1f}" if seconds else "–"
                body.append((label_of(method), words, our_value(size), shown, our_value(peak)))
    notes = (
        "First pose: from the first import of a fresh process until a face is posed; libraries and the model are "
        f"loaded meanwhile. The quicker of {FRESH} processes, which find all files in the system's memory.",
        "Peak memory: all that the process has had resident, libraries too. ONNX Runtime loads the file that leaves "
        "the suite; torch and the fast evaluation load a trained model by torch.",
        "The fast evaluation compiles its kernels then. Their code is kept in the cache for later processes.",
    )
    header = ("", "", "model, MB", "first pose, s", "peak memory, MB")
    return Table(f"Until the first pose: {character}", (header,), tuple(body), notes, text_columns=2)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark from the command line; return the exit code."""
    parser = make_parser(TABLE, "Time fresh processes until their first pose.", profile="whose trainings are timed")
    add_methods(parser, "table3")
    return answer(parser, partial(bench_methods, TABLE, measure, start_table), arguments)


if __name__ == "__main__":
    sys.exit(main())
