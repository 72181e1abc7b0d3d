"""Frames a second for 1, 10 and 100 characters at once, each in another pose, on one core; and their energy.

`make bench-crowd` trains methods where that is missing. The fast evaluation poses one character after the other; torch
and ONNX Runtime get all poses of a frame as one batch, as they are made for, and so does a GPU where there is one, with
the rigid step on the CPU. Where the machine counts the energy of its processor, it also measures that of a thousand
poses.
"""

import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from data_recipes.recipe_paths import character_label
from replicate.approximation.rigid import Attachments, attach
from replicate.base.progress import progress
from replicate.benchmarks.common import (
    add_methods,
    answer,
    bench_methods,
    bench_row,
    distinct_test_poses,
    in_groups,
    make_parser,
    trained_methods,
)
from replicate.config import Config
from replicate.geometry.mesh import Mesh
from replicate.inference.fast_evaluation import fast_evaluation
from replicate.methods import artefacts
from replicate.methods.attachment import placing_attachments
from replicate.methods.method import Method, Model
from replicate.report.results import Row, find
from replicate.report.tables import Table
from replicate.timing.backends import onnx_evaluation
from replicate.timing.gpu_evaluation import gpu_evaluation
from replicate.timing.machine import confined, counters, energy_j, why_no_energy
from replicate.timing.single_poses import (
    BACKENDS,
    FAST,
    GPU,
    ONNX,
    Evaluate,
    Way,
    in_table_order,
    label_of,
    parted,
    time_single_poses,
)

ABOUT = "frames a second for 1, 10 and 100 characters at once, and the energy of a thousand poses"
WRITES = "results/runs/bench/bench_crowd.csv"
TABLE = "bench_crowd"
FRAMES = {1: 50, 10: 20, 100: 5}  # characters at once → frames that are timed
ENERGY, POSES = "energy_of_1000_poses", 1_000


def measure(config: Config, words: Sequence[str]) -> list[Row]:
    """Time frames of several characters with one character's methods, and return the rows."""
    character = character_label(config.character)
    needed = (artefacts.rig_stage, artefacts.samples_stage, artefacts.rigid_stage)
    methods, inputs = trained_methods(TABLE, config, words, *needed)
    poses = distinct_test_poses(inputs)
    ways = ways_of(methods, inputs, artefacts.load_mesh(inputs), artefacts.load_attachments(inputs))
    rows = []
    with confined(), progress(sum(FRAMES.values()), "timing") as bar:
        for count, frames in FRAMES.items():
            for name, time in time_single_poses(ways, crowd(poses, count, frames), frames, bar.update).items():
                for metric, unit, value in (("frame", "ms", time.p05), ("frames_per_s", "count", 1e3 / time.p05)):
                    rows.append(bench_row(TABLE, character, name, f"{metric}[{count}]", unit, value, time.evaluations))
        rows += energy_rows(ways, poses, character)
    return rows


def energy_rows(ways: Mapping[str, Way], poses: Float[np.ndarray, "t m"], character: str) -> list[Row]:
    """Return the energy of a thousand poses by each way; no rows where the machine doesn't count it."""
    rows, processors = [], counters()
    for name, way in ways.items() if processors else ():
        joules, count = energy_j(partial(way.evaluate, poses[:1][None]), processors)
        rows.append(bench_row(TABLE, character, name, ENERGY, "J", POSES * joules, count))
    return rows


def crowd(poses: Float[np.ndarray, "t m"], characters: int, frames: int) -> Float[np.ndarray, "f c m"]:
    """Return frames of several characters that go through the same poses, each from another start."""
    places = np.arange(frames)[:, None] + np.arange(characters) * 7
    return poses[places % len(poses)]


def ways_of(
    methods: Sequence[Method], inputs: Mapping[str, Path], mesh: Mesh, attachments: Attachments
) -> dict[str, Way]:
    """Return the ways to pose the characters of a frame, (1, c, m) parameters, by method's name and ending."""
    ways = {}
    for method in methods:
        model, placing = method.model(inputs), placing_attachments(method, attachments)
        by_ending = {"": _by_torch(model, mesh, placing), ONNX: onnx_evaluation(model, mesh, placing)}
        if alone := fast_evaluation(model, mesh, placing):
            by_ending[FAST] = _one_by_one(alone)
        if torch.cuda.is_available():
            by_ending[GPU] = gpu_evaluation(model, mesh, placing)
        ways |= {method.name + ending: Way(_of_frame(evaluate)) for ending, evaluate in by_ending.items() if evaluate}
    return ways


def _by_torch(model: Model, mesh: Mesh, attachments: Attachments) -> Evaluate:
    return lambda params: attach(mesh, attachments, mesh.neutral + model.offsets(params))


def _one_by_one(evaluate: Evaluate) -> Evaluate:
    return lambda params: np.concatenate([evaluate(each[None]) for each in params])


def _of_frame(evaluate: Evaluate) -> Evaluate:
    return lambda frame: evaluate(frame[0])


def crowd_table(rows: Sequence[Row], character: str) -> Table:
    """Return one character's frames a second by method, way and number of characters, and the energy if it is there.

    Where it isn't, a note says why.
    """
    lines = []
    measured = any(row.metric == ENERGY and row.character == character for row in rows)
    for name in in_table_order({row.method for row in rows if row.character == character}):
        method, ending = parted(name)
        cells = [find(rows, TABLE, character, name, f"frames_per_s[{count}]") for count in FRAMES]
        cells += [find(rows, TABLE, character, name, ENERGY)] if measured else []
        shown = (f"{row.value:,.1f}" if row else "–" for row in cells)
        lines.append((method, (label_of(method), BACKENDS[ending], *shown)))
    energy = ("J a 1,000 poses",) if measured else ()
    header = ("", "", *(f"{count} character{'s' if count > 1 else ''}" for count in FRAMES), *energy)
    notes = (
        "Frames a second on one core, the rigid step with them, by the 5th percentile of the times, since other work "
        "only adds to them. Every character is in another pose.",
        "The fast evaluation poses one after the other, the others all of a frame as one batch.",
        "Energy: of the whole processor while one core poses one character; what it uses at rest counts too."
        if measured
        else why_no_energy(counters()),
    )
    return Table(f"Frames a second: {character}", (header,), in_groups(lines), notes, text_columns=2)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark from the command line; return the exit code."""
    parser = make_parser(TABLE, "Time frames of several characters.", profile="whose trainings are timed")
    add_methods(parser, "table3")
    return answer(parser, partial(bench_methods, TABLE, measure, crowd_table), arguments)


if __name__ == "__main__":
    sys.exit(main())
