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
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from replicate.approximation.metrics import unique_poses
from replicate.base.progress import progress
from replicate.baselines import multiplications
from replicate.benchmarks.common import (  # fmt: skip
    PROFILE,
    add_count,
    add_methods,
    answer,
    artefacts_of,
    bench_folder,
    bench_methods,
    make_parser,
)
from replicate.config import Config
from replicate.drawing.panels import DPI, WIDTH, Words, enlarge, tidy
from replicate.geometry.mesh import Mesh
from replicate.inference.fast_evaluation import placing_of
from replicate.inference.products import Work
from replicate.methods import artefacts
from replicate.methods.method import Method, Model
from replicate.methods.method_registry import choose, method_named
from replicate.methods.plan import Plan
from replicate.regional.model import RegionalModel
from replicate.report.results import Row, find
from replicate.report.tables import Table, round_off
from replicate.timing.jax_evaluation import jax_evaluation
from replicate.timing.machine import CACHE_BYTES, bytes_per_s, can_confine, multiply_adds_per_s, one_core, threads
from replicate.timing.onnx_evaluation import onnx_evaluation
from replicate.timing.plain_evaluation import plain_offsets
from replicate.timing.single_poses import (
    BACKENDS,
    FAST,
    HALF,
    JAX,
    ONNX,
    PLAIN,
    Evaluate,
    Way,
    in_table_order,
    label_of,
    parted,
    time_single_poses,
)

if TYPE_CHECKING:
    import matplotlib.figure
    import matplotlib.text


ABOUT = "how near each evaluation of the networks comes to the peaks of one core's arithmetic and memory"
WRITES = "results/runs/bench/bench_roofline.csv, bench_roofline_<character>.png"
EVALUATIONS = 200
FLOAT = 4  # bytes
MILLION = 1e6


def measure(config: Config, words: Sequence[str], evaluations: int) -> list[Row]:
    """Make what is missing of one character's methods, time their networks in all ways, and return the rows."""
    plan = Plan(config)
    methods = [method for method in choose(words, config) if method.model]
    stages = [artefacts.rig_stage(plan), artefacts.samples_stage(plan)]
    inputs = artefacts_of(TABLE, config, [*stages, *(stage for method in methods for stage in method.stages(plan))])
    mesh, samples = artefacts.load_mesh(inputs), artefacts.load_samples(inputs)
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


# The roofline as a figure: multiplications a second against multiplications a byte, every backend a dot.

TABLE, MACHINE = "bench_roofline", "machine"
PEAK, CACHE, MEMORY = "multiply_adds_per_s", "bytes_per_s[cache]", "bytes_per_s[memory]"
HEIGHT = 6.4  # inches
BILLION = 1e9
MARKERS = {PLAIN: "v", "": "^", JAX: "P", ONNX: "s", FAST: "o", HALF: "D"}
KEYS = {PLAIN: "plain torch", "": "the suite's torch"}
ROOFS = (  # metric, label, line, and the label's place: at this share of the peak, on this side, so many points off
    (CACHE, "caches", "-", 0.11, "bottom", (-2, 4)),
    (MEMORY, "memory", ":", 0.14, "top", (2, -4)),
)
BACKGROUND = {"facecolor": "white", "edgecolor": "none", "pad": 1}  # of letters that lines would cross


def roofline_figure(rows: Sequence[Row], character: str) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): what each way to evaluate the networks of a character reaches of the core's peaks."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    own = [row for row in rows if row.character == character]

    def value(name: str, metric: str) -> float:
        return find(own, TABLE, character, name, metric).value

    names = in_table_order({row.method for row in own} - {MACHINE})
    dots = {name: _dot(value, name) for name in names}
    peak = value(MACHINE, PEAK) / BILLION
    low, high = min(x for x, _ in dots.values()) / 2, max(x for x, _ in dots.values()) * 3
    bottom = min(y for _, y in dots.values()) / 2
    figure = Figure((WIDTH, HEIGHT), dpi=DPI, layout="constrained")
    axes = figure.subplots()
    across = np.geomspace(low, high, 200)
    for metric, _, style, *_ in ROOFS:
        slope = value(MACHINE, metric) / BILLION
        axes.plot(across, np.minimum(peak, slope * across), style, color="0.35", linewidth=1.5, zorder=1)
    place = {"textcoords": "offset points", "ha": "right", "color": "0.35"}
    axes.annotate(f"peak: {peak:.0f} billion a second", (high, peak), (-4, 6), **place)
    for name, (x, y) in dots.items():
        method, ending = parted(name)
        style = {"color": method_named(method).colour, "markersize": 11, "markeredgecolor": "white"}
        style["zorder"] = 4 if ending in (FAST, HALF) else 3
        axes.plot(x, y, MARKERS[ending], **style)
    labels_of_methods = []
    for method in dict.fromkeys(parted(name)[0] for name in names):
        colour = method_named(method).colour
        own_dots = [dots[method + ending] for ending in MARKERS if method + ending in dots]
        axes.plot(*zip(*own_dots, strict=True), color=colour, linewidth=1, alpha=0.35, zorder=2)
        x, y = dots.get(method + FAST, own_dots[-1])
        right = x < np.sqrt(low * high)
        place = {"textcoords": "offset points", "ha": "left" if right else "right", "va": "center", "color": colour}
        place |= {"bbox": BACKGROUND, "zorder": 2.5}
        label = axes.annotate(method_named(method).label, (x, y), (11 if right else -11, 0), **place)
        labels_of_methods.append(label)
    axes.set(xscale="log", yscale="log", xlim=(low, high), ylim=(bottom, peak * 2))
    axes.set_xlabel("multiplications a byte of weights")
    axes.set_ylabel("billion multiplications a second")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:g}")
    present = [ending for ending in MARKERS if any(parted(name)[1] == ending for name in names)]
    keys = [Line2D([], [], marker=MARKERS[e], color="0.35", linestyle="", markersize=10) for e in present]
    axes.legend(keys, [KEYS.get(ending, BACKENDS[ending]) for ending in present], loc="lower right", frameon=False)
    figure.draw_without_rendering()  # the layout decides how steep a slope is
    for metric, label, _, share, side, offset in ROOFS:
        slope = value(MACHINE, metric) / BILLION
        at = max(1.1 * low, peak / slope * share)
        (x0, y0), (x1, y1) = axes.transData.transform([(at, slope * at), (2 * at, slope * 2 * at)])
        place = {"rotation": np.degrees(np.arctan2(y1 - y0, x1 - x0)), "rotation_mode": "anchor", "va": side}
        words = f"{label}, {slope:.0f} GB/s"
        axes.annotate(words, (at, slope * at), offset, textcoords="offset points", color="0.35", **place)
    tidy(axes)
    enlarge(axes)
    figure.draw_without_rendering()
    _lift(labels_of_methods)
    labels = {name: f"{method_named(parted(name)[0]).label}, {BACKENDS[parted(name)[1]]}" for name in names}
    phrases = [f"{labels[name]}: {y:.2g} billion a second at {x:.2g} a byte" for name, (x, y) in dots.items()]
    return figure, Words(
        f"A roofline chart for {character}, with a peak of {peak:.0f} billion a second: {'; '.join(phrases)}.",
        f"Roofline of one core: {character}. A dot is one way to evaluate one method's networks. No dot can lie above "
        "the flat line, the core's arithmetic; below the slopes weights come from caches or from memory fast enough.",
    )


def _lift(labels: "Sequence[matplotlib.text.Annotation]") -> None:
    """Move labels upwards that others lie on, the lowest first. They have been drawn, so that their sizes are known."""
    for lower, upper in combinations(sorted(labels, key=lambda label: label.xy[1]), 2):
        below, above = lower.get_window_extent(), upper.get_window_extent()
        if below.overlaps(above):
            across, up = upper.xyann
            upper.xyann = across, up + (below.y1 - above.y0) * 72 / upper.figure.dpi + 1


def _dot(value: object, name: str) -> tuple[float, float]:
    """Return multiplications a byte, and billions of them a second."""
    count = value(name, "multiplications")
    return count / (1e6 * value(name, "read")), count / value(name, "network") / 1e6
