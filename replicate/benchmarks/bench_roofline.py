"""The roofline: how near each evaluation of the networks comes to what one core can do, and what holds it back.

`make bench-roofline` measures the core's peak of float32 multiply-adds and the bytes that it reads in a second, makes
what is missing of the methods, and times every backend's networks on one core, without the rigid step. Multiplications
and bytes follow from the architecture. For the fast evaluation they are those that are really done: rows of zero
parameters and pixels that nothing reads are left out.
"""

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float

from replicate.approximation import multiplications
from replicate.approximation.evaluation import unique_poses
from replicate.approximation.regional_model import RegionalModel
from replicate.artefacts import built_rig, drawn_samples
from replicate.artefacts.plan import Plan
from replicate.benchmarks.common import (
    PROFILE,
    add_count,
    add_methods,
    answer,
    artefacts_of,
    bench_folder,
    bench_methods,
    make_parser,
)  # fmt: skip
from replicate.benchmarks.roofline_figure import BILLION, CACHE, MACHINE, MEMORY, PEAK, TABLE, roofline_figure
from replicate.config import Config
from replicate.engine.progress import progress
from replicate.geometry.mesh import Mesh
from replicate.inference.fast_evaluation import placing_of
from replicate.inference.work import Work
from replicate.methods.method import Method, Model
from replicate.methods.method_registry import choose
from replicate.report.results import Row, find
from replicate.report.tables import Table, round_off
from replicate.timing.cores import can_confine, one_core, threads
from replicate.timing.jax_evaluation import jax_evaluation
from replicate.timing.machine_peaks import CACHE_BYTES, bytes_per_s, multiply_adds_per_s
from replicate.timing.onnx_evaluation import onnx_evaluation
from replicate.timing.plain_evaluation import plain_offsets
from replicate.timing.single_poses import Evaluate, Way, time_single_poses
from replicate.timing.timed_names import BACKENDS, FAST, HALF, JAX, ONNX, PLAIN, in_table_order, label_of, parted

ABOUT = "how near each evaluation of the networks comes to the peaks of one core's arithmetic and memory"
WRITES = "results/runs/bench/bench_roofline.csv, bench_roofline_<character>.png"
EVALUATIONS = 200
FLOAT = 4  # bytes
MILLION = 1e6


def measure(config: Config, words: Sequence[str], evaluations: int) -> list[Row]:
    """Make what is missing of one character's methods, time their networks in all ways, and return the rows."""
    plan = Plan(config)
    methods = [method for method in choose(words, config) if method.model]
    stages = [built_rig.stage(plan), drawn_samples.stage(plan)]
    inputs = artefacts_of(TABLE, config, [*stages, *(stage for method in methods for stage in method.stages(plan))])
    mesh, samples = built_rig.load_mesh(inputs), drawn_samples.load(inputs)
    poses = np.asarray(samples.test_params[unique_poses(samples.test_params)], np.float32)
    ways, works = ways_of(methods, inputs, mesh, poses)
    with one_core() if can_confine() else threads(1), progress(evaluations, "timing") as bar:
        peaks = {PEAK: multiply_adds_per_s(), CACHE: bytes_per_s(CACHE_BYTES), MEMORY: bytes_per_s()}
        times = time_single_poses({name: Way(way) for name, way in ways.items()}, poses, evaluations, bar.update)
    numbers = [(MACHINE, metric, "count", value, None) for metric, value in peaks.items()]
    for name, time in times.items():
        work, milliseconds, count = works[name], time.p05, time.evaluations
        rate = 1e3 * work.multiplications / milliseconds
        roof = min(peaks[PEAK], peaks[CACHE] * work.multiplications / work.read_bytes)
        eager = times.get(parted(name)[0] + PLAIN, times[parted(name)[0]])
        numbers += [
            (name, "network", "ms", milliseconds, count),
            (name, "network_median", "ms", time.median, count),
            (name, "multiplications", "count", work.multiplications, count),
            (name, "read", "MB", work.read_bytes / MILLION, count),
            (name, "share_of_peak", "ratio", rate / peaks[PEAK], count),
            (name, "share_of_roof", "ratio", rate / roof, count),
            (name, "times_as_fast_as_torch", "ratio", eager.p05 / milliseconds, count),
        ]
    return [
        Row(TABLE, plan.character, name, metric, unit, float(value), None, 1, count, PROFILE, plan.character)
        for name, metric, unit, value, count in numbers
    ]


def ways_of(
    methods: Sequence[Method], inputs: Mapping[str, Path], mesh: Mesh, poses: Float[np.ndarray, "t m"]
) -> tuple[dict[str, Evaluate], dict[str, Work]]:
    """Return by name, method and ending, the ways to evaluate the networks, and the work of each on a usual pose."""
    ways: dict[str, Evaluate] = {}
    works: dict[str, Work] = {}
    for method in methods:
        model = method.model(inputs)
        found = {PLAIN: plain_offsets(model), "": model.offsets}
        found |= {JAX: jax_evaluation(model, mesh, None), ONNX: onnx_evaluation(model, mesh, None)}
        for ending, way in found.items():
            if way:
                ways[method.name + ending], works[method.name + ending] = way, architecture_work(model)
        for ending, halves in ((FAST, False), (HALF, True)):
            if placing := placing_of(model, mesh, halves):
                ways[method.name + ending] = _placed(placing.place, mesh.neutral)
                each = np.mean([placing.work(pose) for pose in poses], axis=0)
                works[method.name + ending] = Work(*map(round, each.tolist()))
    return ways, works


def architecture_work(model: Model) -> Work:
    """Return the multiplications of a model's architecture, and the bytes of all its weights as float32."""
    count = multiplications.of_model(model)
    if isinstance(model, RegionalModel):  # each weight and each number of a basis is multiplied once
        return Work(count, FLOAT * count)
    return Work(count, round(model.size_mb() * MILLION))


def _placed(place: Callable, neutral: np.ndarray) -> Evaluate:
    out = np.array(neutral, np.float32)

    def evaluate(pose: np.ndarray) -> np.ndarray:
        np.copyto(out, neutral)
        place(pose[0], out)
        return out

    return evaluate


def roofline_table(rows: Sequence[Row], character: str) -> Table:
    """Return one character's backends: times, work, and shares of what the core can do."""
    own = [row for row in rows if row.character == character]

    def value(name: str, metric: str) -> float:
        return find(own, TABLE, character, name, metric).value

    body, last = [], ""
    for name in in_table_order({row.method for row in own} - {MACHINE}):
        method, ending = parted(name)
        if last and method != last:
            body.append(None)
        label, last = f"{label_of(method)}: {BACKENDS[ending]}", method
        milliseconds, count = value(name, "network"), value(name, "multiplications")
        body.append(
            (
                label, round_off(milliseconds, "ms"), f"{value(name, 'times_as_fast_as_torch'):.1f}",
                f"{count / MILLION:.1f}", f"{value(name, 'read'):.1f}", f"{count / milliseconds / MILLION:.1f}",
                f"{100 * value(name, 'share_of_peak'):.0f} %", f"{100 * value(name, 'share_of_roof'):.0f} %",
            )
        )  # fmt: skip
    header = ("", "ms", "× torch", "million products", "MB read", "billion a second", "of the peak", "of the roof")
    peak, cache, memory = (value(MACHINE, metric) / BILLION for metric in (PEAK, CACHE, MEMORY))
    notes = (
        f"One core: {peak:.1f} billion multiply-adds of float32 a second; it reads {cache:.0f} GB/s from its caches "
        f"(an array of {CACHE_BYTES / MILLION:.0f} MB) and {memory:.0f} GB/s from memory.",
        "Networks alone, without the rigid step; 5th percentiles of the times, since other work only adds to them.",
        "× torch: over plain torch, or the suite's where there is none.",
        "Products and bytes: of the architecture, with weights in float32. Of the fast ones: what is done for a "
        "usual test pose, where pixels that nothing reads and rows of zero parameters are left out.",
        "The roof: the peak, or what the caches deliver for so many products a byte, where that is less.",
    )
    return Table(f"Roofline: {character}", (header,), tuple(body), notes)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark from the command line; return the exit code."""
    parser = make_parser(TABLE, "Measure how near to the machine's peaks networks are.", profile="whose trainings")
    add_methods(parser, "table3")
    add_count(parser, "rounds", EVALUATIONS, "poses that each is timed on")
    return answer(parser, _run, arguments)


def _run(options: argparse.Namespace, command_line: Sequence[str]) -> None:
    own = partial(measure, evaluations=options.rounds)
    bench_methods(TABLE, own, roofline_table, options, command_line, draw=_draw)


def _draw(rows: Sequence[Row], character: str) -> None:
    from replicate.drawing.panels import save_figure

    figure, words = roofline_figure(rows, character)
    save_figure(figure, bench_folder() / f"{TABLE}_{character}.png", words)


if __name__ == "__main__":
    sys.exit(main())
