"""Frames a second for 1, 10 and 100 characters at once, each in a pose of its own, on one core.

Beside it stands what a method needs before that: its size, and the seconds and the memory of a fresh process until its
first pose. `make bench-crowd` makes what is missing of the methods. The fast evaluation poses one character after the
other; torch and ONNX Runtime get all poses of a frame as one batch, which is what they are made for.
"""

import argparse
import sys
import tempfile
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from replicate.approximation.evaluation import unique_poses
from replicate.approximation.rigid import Attachments, attach
from replicate.artefacts import built_rig, drawn_samples, rigid_segments
from replicate.artefacts.plan import Plan
from replicate.benchmarks import first_pose
from replicate.benchmarks.common import PROFILE, answer, artefacts_of, make_parser, publish, split_names
from replicate.config import Config, resolve
from replicate.engine.progress import progress
from replicate.geometry.mesh import Mesh
from replicate.inference.fast_evaluation import fast_evaluation
from replicate.methods.method import Method, Model
from replicate.methods.method_registry import choose, sections
from replicate.report.results import Row, find
from replicate.report.tables import Table, round_off
from replicate.timing.cores import can_confine, one_core, threads
from replicate.timing.onnx_evaluation import onnx_bytes, onnx_evaluation
from replicate.timing.single_poses import Evaluate, Way, time_single_poses
from replicate.timing.timed_names import BACKENDS, FAST, ONNX, in_table_order, label_of, parted

ABOUT = "frames a second for 1, 10 and 100 characters at once; memory and seconds until the first pose"
WRITES = "results/runs/bench/bench_crowd.csv"
TABLE = "bench_crowd"
FRAMES = {1: 50, 10: 20, 100: 5}  # by the number of characters, how many frames are timed
FRESH = 2  # processes that are started of each way; the quicker counts


def measure(config: Config, words: Sequence[str]) -> list[Row]:
    """Make what is missing of one character's methods, time frames of several characters, and return the rows."""
    plan = Plan(config)
    methods = [method for method in choose(words, config) if method.model]
    shared = [module.stage(plan) for module in (built_rig, drawn_samples, rigid_segments)]
    inputs = artefacts_of(TABLE, config, [*shared, *(stage for method in methods for stage in method.stages(plan))])
    samples = drawn_samples.load(inputs)
    poses = np.asarray(samples.test_params[unique_poses(samples.test_params)], np.float32)
    ways = ways_of(methods, inputs, built_rig.load_mesh(inputs), rigid_segments.load(inputs))
    rows = []
    with one_core() if can_confine() else threads(1), progress(sum(FRAMES.values()), "timing") as bar:
        for characters, frames in FRAMES.items():
            for name, time in time_single_poses(ways, crowd(poses, characters, frames), frames, bar.update).items():
                facts = (None, 1, time.evaluations, PROFILE, plan.character)
                for metric, unit, value in (("frame", "ms", time.p05), ("frames_per_s", "count", 1e3 / time.p05)):
                    rows.append(Row(TABLE, plan.character, name, f"{metric}[{characters}]", unit, value, *facts))
    return [*rows, *first_poses(plan.character, methods, ways, inputs, poses[0])]


def first_poses(
    character: str,
    methods: Sequence[Method],
    ways: Collection[str],
    inputs: Mapping[str, Path],
    pose: Float[np.ndarray, " m"],
) -> list[Row]:
    """Return the size of each method's model, and what a fresh process needs until it has posed it once, by each way.

    ways: names of those that there are, as `ways_of` has them.
    """
    folders = {name: str(Path(folder).absolute()) for name, folder in inputs.items()}
    own = [(method, method.name + ending, ending) for method in methods for ending in ("", ONNX, FAST)]
    own = [(method, name, ending) for method, name, ending in own if name in ways]
    numbers = []
    with tempfile.TemporaryDirectory() as scratch, progress(FRESH * len(own), "fresh processes") as bar:
        for method, name, ending in own:
            model = {"method": method.name, "inputs": folders}
            if ending == ONNX:
                file = Path(scratch) / f"{name}.onnx"
                loaded = method.model(inputs)
                file.write_bytes(onnx_bytes(loaded, built_rig.load_mesh(inputs), rigid_segments.load(inputs)))
                model = {"file": str(file)}
            found = []
            for _ in range(FRESH):
                found.append(first_pose.first_pose(ending, pose.tolist(), model))
                bar.update(1)
            best = min(found, key=lambda one: one["seconds"])
            numbers.append((name, "first_pose", "s", best["seconds"], FRESH))
            if best["peak_mb"] is not None:
                numbers.append((name, "peak_memory", "MB", best["peak_mb"], FRESH))
            if not ending:
                numbers.append((name, "model_size", "MB", method.model(inputs).size_mb(), None))
    return [
        Row(TABLE, character, name, metric, unit, float(value), None, 1, count, PROFILE, character)
        for name, metric, unit, value, count in numbers
    ]


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
        model = method.model(inputs)
        found = {"": _by_torch(model, mesh, attachments), ONNX: onnx_evaluation(model, mesh, attachments)}
        if alone := fast_evaluation(model, mesh, attachments):
            found[FAST] = _one_by_one(alone)
        ways |= {method.name + ending: Way(_of_frame(evaluate)) for ending, evaluate in found.items() if evaluate}
    return ways


def _by_torch(model: Model, mesh: Mesh, attachments: Attachments) -> Evaluate:
    return lambda params: attach(mesh, attachments, mesh.neutral + model.offsets(params))


def _one_by_one(evaluate: Evaluate) -> Evaluate:
    return lambda params: np.concatenate([evaluate(each[None]) for each in params])


def _of_frame(evaluate: Evaluate) -> Evaluate:
    return lambda frame: evaluate(frame[0])


def crowd_table(rows: Sequence[Row], character: str) -> Table:
    """Return one character's frames a second by method, way and number of characters."""
    body, last = [], ""
    for name in in_table_order({row.method for row in rows if row.character == character}):
        method, ending = parted(name)
        if last and method != last:
            body.append(None)
        found = [find(rows, TABLE, character, name, f"frames_per_s[{many}]") for many in FRAMES]
        body.append((label_of(method), BACKENDS[ending], *(f"{row.value:,.1f}" if row else "–" for row in found)))
        last = method
    header = ("", "", *(f"{many} character{'s' if many > 1 else ''}" for many in FRAMES))
    notes = (
        "Frames a second on one core, the rigid step with them, by the 5th percentile of the times, since other work "
        "only adds to them. Every character is in another pose.",
        "The fast evaluation poses one after the other, the others all of a frame as one batch.",
    )
    return Table(f"Frames a second: {character}", (header,), tuple(body), notes, text_columns=2)


def start_table(rows: Sequence[Row], character: str) -> Table | None:
    """Return what one character's methods need until the first pose, by way; None where it is not measured."""
    metrics = (("model_size", "MB"), ("first_pose", "s"), ("peak_memory", "MB"))
    names = in_table_order({row.method for row in rows if row.character == character and row.metric == "first_pose"})
    body = []
    for name in names:
        method, ending = parted(name)
        found = [
            (find(rows, TABLE, character, method if metric == "model_size" else name, metric), unit)
            for metric, unit in metrics
        ]
        cells = (_cell(row, unit) for row, unit in found)
        body.append((label_of(method), BACKENDS[ending], *cells))
    header = ("", "", "model, MB", "first pose, s", "peak memory, MB")
    notes = (
        "First pose: from the first import of a fresh process until a face is posed; libraries and the model are "
        f"loaded meanwhile. The quicker of {FRESH} processes, which find all files in the system's memory.",
        "Peak memory: all that the process has had resident, libraries too. ONNX Runtime loads the file that leaves "
        "the suite; torch and the fast evaluation load a trained model by torch.",
        "The fast evaluation compiles its kernels then, unless NUMBA_CACHE_DIR names a folder where they are.",
    )
    return Table(f"Until the first pose: {character}", (header,), tuple(body), notes, text_columns=2) if body else None


def _cell(row: Row | None, unit: str) -> str:
    if row is None:
        return "–"
    return f"{row.value:.1f}" if unit == "s" else round_off(row.value, unit)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark from the command line; return the exit code."""
    parser = make_parser(TABLE, "Time frames of several characters.", profile="whose trainings are timed")
    parser.add_argument("--methods", nargs="+", default=["standard"], help="as for table3 (default: standard)")
    return answer(parser, _run, arguments)


def _run(options: argparse.Namespace, command_line: Sequence[str]) -> None:
    words = split_names(" ".join(options.methods))
    choose(words)
    for character in split_names(options.characters):
        config = resolve(character, options.profile, sections=sections(options.profile))
        rows = measure(config, words)
        tables = [make(rows, rows[0].character) for make in (crowd_table, start_table)]
        publish(TABLE, rows, filter(None, tables), command_line)


if __name__ == "__main__":
    sys.exit(main())
