"""The roofline: how near each evaluation of the networks comes to what one core can do, and what holds it back.

`make bench-roofline` measures the core's peak of float32 multiply-adds and the bytes that it reads in a second, trains
methods where that is missing, and times every backend's networks on one core, without the rigid step. Multiplications
and bytes follow from the architecture. For the fast evaluation they are those that really happen: rows of zero
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

from data_recipes.recipe_paths import character_label
from replicate.base.progress import progress
from replicate.baselines import multiplications
from replicate.benchmarks.common import (
    add_count,
    add_methods,
    answer,
    bench_methods,
    bench_row,
    distinct_test_poses,
    in_groups,
    make_parser,
    save_picture,
    trained_methods,
    without_rigid_step,
)
from replicate.config import Config
from replicate.drawing.panels import DPI, WIDTH, Words, enlarge, tidy
from replicate.geometry.mesh import Mesh
from replicate.inference.fast_evaluation import placing_of
from replicate.inference.products import Work
from replicate.methods import artefacts
from replicate.methods.method import Method, Model
from replicate.methods.method_registry import method_named
from replicate.regional.model import RegionalModel
from replicate.report.results import Row, find
from replicate.report.tables import Table, round_off
from replicate.timing.backends import onnx_evaluation, plain_offsets
from replicate.timing.jax_evaluation import jax_evaluation
from replicate.timing.machine import CACHE_BYTES, bytes_per_s, confined, multiply_adds_per_s
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
    """Time the networks of one character's methods in all ways, and return the rows."""
    methods, inputs = trained_methods(TABLE, config, words, artefacts.rig_stage, artefacts.samples_stage)
    poses = distinct_test_poses(inputs)
    ways, works = ways_of(methods, inputs, artefacts.load_mesh(inputs), poses)
    with confined(), progress(evaluations, "timing") as bar:
        peaks = {PEAK: multiply_adds_per_s(), CACHE: bytes_per_s(CACHE_BYTES), MEMORY: bytes_per_s()}
        times = time_single_poses({name: Way(way) for name, way in ways.items()}, poses, evaluations, bar.update)
    measured = [(MACHINE, metric, "count", value, None) for metric, value in peaks.items()]
    for name, time in times.items():
        work, milliseconds, count = works[name], time.p05, time.evaluations
        rate = 1e3 * work.multiplications / milliseconds
        roof = min(peaks[PEAK], peaks[CACHE] * work.multiplications / work.read_bytes)
        method, _ = parted(name)
        torch = times.get(method + PLAIN, times[method])
        measured += [
            (name, "network", "ms", milliseconds, count),
            (name, "network_median", "ms", time.median, count),
            (name, "multiplications", "count", work.multiplications, count),
            (name, "read", "MB", work.read_bytes / MILLION, count),
            (name, "share_of_peak", "ratio", rate / peaks[PEAK], count),
            (name, "share_of_roof", "ratio", rate / roof, count),
            (name, "times_as_fast_as_torch", "ratio", torch.p05 / milliseconds, count),
        ]
    character = character_label(config.character)
    return [bench_row(TABLE, character, *facts) for facts in measured]


def ways_of(
    methods: Sequence[Method], inputs: Mapping[str, Path], mesh: Mesh, poses: Float[np.ndarray, "t m"]
) -> tuple[dict[str, Evaluate], dict[str, Work]]:
    """Return the ways to evaluate the networks by method's name and ending, and the work of each on a usual pose."""
    ways: dict[str, Evaluate] = {}
    works: dict[str, Work] = {}
    for method in methods:
        model = method.model(inputs)
        by_ending = {PLAIN: plain_offsets(model), "": model.offsets}
        by_ending |= {JAX: jax_evaluation(model, mesh, None), ONNX: onnx_evaluation(model, mesh, None)}
        for ending, way in by_ending.items():
            if way:
                ways[method.name + ending], works[method.name + ending] = way, architecture_work(model)
        for ending, halves in ((FAST, False), (HALF, True)):
            if placing := placing_of(model, mesh, halves):
                ways[method.name + ending] = without_rigid_step(placing, mesh)
                mean = np.mean([placing.work(pose) for pose in poses], axis=0)
                works[method.name + ending] = Work(*map(round, mean.tolist()))
    return ways, works


def architecture_work(model: Model) -> Work:
    """Return the multiplications of a model's architecture, and the bytes of all its weights as float32."""
    count = multiplications.of_model(model)
    if isinstance(model, RegionalModel):  # each weight and each number of a basis is multiplied once
        return Work(count, FLOAT * count)
    return Work(count, round(model.size_mb() * MILLION))


def _names(rows: Sequence[Row], character: str) -> list[str]:
    return in_table_order({row.method for row in rows if row.character == character} - {MACHINE})


def _value(rows: Sequence[Row], character: str, name: str, metric: str) -> float:
    return find(rows, TABLE, character, name, metric).value


def roofline_table(rows: Sequence[Row], character: str) -> Table:
    """Return one character's backends: times, work, and shares of what the core can do."""
    value, lines = partial(_value, rows, character), []
    for name in _names(rows, character):
        method, ending = parted(name)
        milliseconds, count = value(name, "network"), value(name, "multiplications")
        lines.append((method, (
            f"{label_of(method)}: {BACKENDS[ending]}", round_off(milliseconds, "ms"),
            f"{value(name, 'times_as_fast_as_torch'):.1f}",
            f"{count / MILLION:.1f}", f"{value(name, 'read'):.1f}", f"{count / milliseconds / MILLION:.1f}",
            f"{100 * value(name, 'share_of_peak'):.0f} %", f"{100 * value(name, 'share_of_roof'):.0f} %",
        )))  # fmt: skip
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
    return Table(f"Roofline: {character}", (header,), in_groups(lines), notes)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark from the command line; return the exit code."""
    parser = make_parser(TABLE, "Measure how near to the machine's peaks networks are.", profile="whose trainings")
    add_methods(parser, "table3")
    add_count(parser, "rounds", EVALUATIONS, "poses that each is timed on")
    return answer(parser, _run, arguments)


def _run(options: argparse.Namespace, command_line: Sequence[str]) -> None:
    timed = partial(measure, evaluations=options.rounds)
    bench_methods(TABLE, timed, roofline_table, options, command_line, draw=_draw)


def _draw(rows: Sequence[Row], character: str) -> None:
    save_picture(f"{TABLE}_{character}", roofline_figure(rows, character))


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
    """Return (figure, words): how near each way to evaluate a character's networks comes to the core's peaks."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    # the dots, and the frame that holds them all
    value, names = partial(_value, rows, character), _names(rows, character)
    dots = {name: _dot(value, name) for name in names}
    peak = value(MACHINE, PEAK) / BILLION
    low, high = min(x for x, _ in dots.values()) / 2, max(x for x, _ in dots.values()) * 3
    bottom = min(y for _, y in dots.values()) / 2
    figure = Figure((WIDTH, HEIGHT), dpi=DPI, layout="constrained")
    axes = figure.subplots()

    # the roofs, and a dot for each way
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

    # a thin line through each method's dots, and its name at one of them
    labels_of_methods = []
    for method in dict.fromkeys(parted(name)[0] for name in names):
        colour = method_named(method).colour
        of_method = [dots[method + ending] for ending in MARKERS if method + ending in dots]
        axes.plot(*zip(*of_method, strict=True), color=colour, linewidth=1, alpha=0.35, zorder=2)
        x, y = dots.get(method + FAST, of_method[-1])
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

    # words along the slopes, once the layout has decided how steep they are
    figure.draw_without_rendering()
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
    """Move up labels that lie on others, the lowest first. They are drawn already, so that their sizes are known."""
    for lower, upper in combinations(sorted(labels, key=lambda label: label.xy[1]), 2):
        below, above = lower.get_window_extent(), upper.get_window_extent()
        if below.overlaps(above):
            across, up = upper.xyann
            upper.xyann = across, up + (below.y1 - above.y0) * 72 / upper.figure.dpi + 1


def _dot(value: Callable[[str, str], float], name: str) -> tuple[float, float]:
    """Return the multiplications a byte, and the billions of them a second; value: (name, metric) → number."""
    count = value(name, "multiplications")
    return count / (1e6 * value(name, "read")), count / value(name, "network") / 1e6


if __name__ == "__main__":
    sys.exit(main())
