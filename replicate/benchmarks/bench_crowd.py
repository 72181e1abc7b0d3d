"""Frames a second for 1, 10 and 100 characters at once, each in a pose of its own, on one core; and their energy.

`make bench-crowd` makes what is missing of the methods. The fast evaluation poses one character after the other; torch
and ONNX Runtime get all poses of a frame as one batch, which is what they are made for, and so does a GPU where there
is one, with the rigid step on the CPU. Where the machine counts the energy of its processor, that of a thousand poses
stands beside the frames.
"""

import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from replicate.approximation.metrics import unique_poses
from replicate.approximation.rigid import Attachments, attach
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
from replicate.config import Config
from replicate.geometry.mesh import Mesh
from replicate.inference.fast_evaluation import fast_evaluation
from replicate.methods import artefacts
from replicate.methods.method import Method, Model
from replicate.methods.method_registry import choose
from replicate.methods.plan import Plan
from replicate.report.results import Row, find
from replicate.report.tables import Table
from replicate.timing.gpu_evaluation import gpu_evaluation
from replicate.timing.machine import can_confine, counters, energy_j, one_core, threads, why_no_energy
from replicate.timing.onnx_evaluation import onnx_evaluation
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
FRAMES = {1: 50, 10: 20, 100: 5}  # by the number of characters, how many frames are timed
ENERGY, POSES = "energy_of_1000_poses", 1_000


def measure(config: Config, words: Sequence[str]) -> list[Row]:
    """Make what is missing of one character's methods, time frames of several characters, and return the rows."""
    plan = Plan(config)
    methods = [method for method in choose(words, config) if method.model]
    shared = [stage(plan) for stage in (artefacts.rig_stage, artefacts.samples_stage, artefacts.rigid_stage)]
    inputs = artefacts_of(TABLE, config, [*shared, *(stage for method in methods for stage in method.stages(plan))])
    samples = artefacts.load_samples(inputs)
    poses = np.asarray(samples.test_params[unique_poses(samples.test_params)], np.float32)
    ways = ways_of(methods, inputs, artefacts.load_mesh(inputs), artefacts.load_attachments(inputs))
    rows = []
    with one_core() if can_confine() else threads(1), progress(sum(FRAMES.values()), "timing") as bar:
        for characters, frames in FRAMES.items():
            for name, time in time_single_poses(ways, crowd(poses, characters, frames), frames, bar.update).items():
                facts = (None, 1, time.evaluations, PROFILE, plan.character)
                for metric, unit, value in (("frame", "ms", time.p05), ("frames_per_s", "count", 1e3 / time.p05)):
                    rows.append(Row(TABLE, plan.character, name, f"{metric}[{characters}]", unit, value, *facts))
        rows += energy_rows(ways, poses, plan.character)
    return rows


def energy_rows(ways: Mapping[str, Way], poses: Float[np.ndarray, "t m"], character: str) -> list[Row]:
    """Return the energy of a thousand poses by each way, of one character; nothing where the machine does not tell."""
    rows, over = [], counters()
    for name, way in ways.items() if over else ():
        joules, count = energy_j(partial(way.evaluate, poses[:1][None]), over)
        rows.append(Row(TABLE, character, name, ENERGY, "J", POSES * joules, None, 1, count, PROFILE, character))
    return rows


def crowd(poses: Float[np.ndarray, "t m"], characters: int, frames: int) -> Float[np.ndarray, "f c m"]:
    """Return frames of several characters, each at another place of the same poses, in which all go on."""
    places = np.arange(frames)[:, None] + np.arange(characters) * 7
    return poses[places % len(poses)]


def ways_of(
    methods: Sequence[Method], inputs: Mapping[str, Path], mesh: Mesh, attachments: Attachments
) -> dict[str, Way]:
    """Return by name, method and ending, the ways to pose the characters of a frame, (1, c, m) parameters."""
    ways = {}
    for method in methods:
        model, placing = method.model(inputs), placing_attachments(method, attachments)
        found = {"": _by_torch(model, mesh, placing), ONNX: onnx_evaluation(model, mesh, placing)}
        if alone := fast_evaluation(model, mesh, placing):
            found[FAST] = _one_by_one(alone)
        if torch.cuda.is_available():
            found[GPU] = gpu_evaluation(model, mesh, placing)
        ways |= {method.name + ending: Way(_of_frame(evaluate)) for ending, evaluate in found.items() if evaluate}
    return ways


def _by_torch(model: Model, mesh: Mesh, attachments: Attachments) -> Evaluate:
    return lambda params: attach(mesh, attachments, mesh.neutral + model.offsets(params))


def _one_by_one(evaluate: Evaluate) -> Evaluate:
    return lambda params: np.concatenate([evaluate(each[None]) for each in params])


def _of_frame(evaluate: Evaluate) -> Evaluate:
    return lambda frame: evaluate(frame[0])


def crowd_table(rows: Sequence[Row], character: str) -> Table:
    """Return one character's frames a second by method, way and number of characters, and the energy if it is there.

    A note says why there is none on this machine.
    """
    body, last = [], ""
    measured = any(row.metric == ENERGY and row.character == character for row in rows)
    for name in in_table_order({row.method for row in rows if row.character == character}):
        method, ending = parted(name)
        if last and method != last:
            body.append(None)
        found = [find(rows, TABLE, character, name, f"frames_per_s[{many}]") for many in FRAMES]
        found += [find(rows, TABLE, character, name, ENERGY)] if measured else []
        body.append((label_of(method), BACKENDS[ending], *(f"{row.value:,.1f}" if row else "–" for row in found)))
        last = method
    energy = ("J a 1,000 poses",) if measured else ()
    header = ("", "", *(f"{many} character{'s' if many > 1 else ''}" for many in FRAMES), *energy)
    notes = (
        "Frames a second on one core, the rigid step with them, by the 5th percentile of the times, since other work "
        "only adds to them. Every character is in another pose.",
        "The fast evaluation poses one after the other, the others all of a frame as one batch.",
        "Energy: of the whole processor while one core poses one character; what it uses at rest counts too."
        if measured
        else why_no_energy(counters()),
    )
    return Table(f"Frames a second: {character}", (header,), tuple(body), notes, text_columns=2)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark from the command line; return the exit code."""
    parser = make_parser(TABLE, "Time frames of several characters.", profile="whose trainings are timed")
    add_methods(parser, "table3")
    return answer(parser, partial(bench_methods, TABLE, measure, crowd_table), arguments)


if __name__ == "__main__":
    sys.exit(main())
