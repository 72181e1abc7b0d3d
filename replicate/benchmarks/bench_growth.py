"""How the cost of a pose grows with vertices, segments, map size and components: each varied alone, on one core.

`make bench-growth` needs no character and no training: weights are random, since times depend only on their shapes, and
on how many parameters are zero, whose rows the fast evaluation leaves out. A pose here moves a quarter of the controls.
All other sizes are about those of `teen`. Networks are timed without the rigid step.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Float32

from replicate.approximation import cnn
from replicate.approximation.model import SegmentedModel
from replicate.approximation.segments import Segment
from replicate.base.progress import progress
from replicate.baselines import dense
from replicate.baselines.line import Line
from replicate.benchmarks.common import add_count, answer, bench_row, publish, save_picture, without_rigid_step
from replicate.config import CoarseConfig, DenseConfig
from replicate.drawing.panels import DPI, WIDTH, Words, enlarge, error_scale, tidy
from replicate.geometry.mesh import Mesh
from replicate.inference.fast_evaluation import placing_of
from replicate.methods.method_registry import method_named
from replicate.methods.regional import RegionalConfig
from replicate.regional.model import RegionalModel, StoredBasis
from replicate.regional.networks import fresh_networks
from replicate.report.results import Row, find
from replicate.report.tables import Table, our_value, round_off
from replicate.timing.backends import plain_offsets
from replicate.timing.machine import confined
from replicate.timing.single_poses import (
    BACKENDS,
    FAST,
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


# Models of any size with random weights.

COARSE, DENSE, LINEAR, OURS = "coarse", "dense", "linear", "regional"
PARAMETERS, SEEN = 256, 100  # of the rig, and by the network of each segment, and of each region
REGIONAL = RegionalConfig()  # the settings of our method
RING = 5.3  # a region of k vertices has about this times √k in the ring about it, as on the teen


@dataclass(frozen=True)
class Face:
    """The sizes that are varied; by default about those of `teen`."""

    vertices: int = 11_200
    segments: int = 8
    map_size: int = 32
    components: int = 96


def models_of(face: Face, names: tuple[str, ...]) -> dict[str, SegmentedModel | RegionalModel]:
    """Return the models of a face by method: networks of the usual widths, segments of equal sizes.

    Vertices lie anywhere in their charts, so that all parts of a map are read alike.
    """
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    parts = np.array_split(np.arange(face.vertices, dtype=np.int32), face.segments)
    segments = [
        Segment(
            f"segment {k}",
            vertices,
            rng.uniform(size=(len(vertices), 2)).astype(np.float32),
            _some_parameters(rng),
        )
        for k, vertices in enumerate(parts)
    ]
    maps = cnn.shape_facts(CoarseConfig(map_size=face.map_size))
    make = {
        COARSE: lambda: _segmented([cnn.make_network(s, maps) for s in segments], segments, face),
        DENSE: lambda: _segmented(
            [dense.make_network(s, dense.shape_facts(DenseConfig())) for s in segments], segments, face
        ),
        LINEAR: lambda: _segmented([_line(s) for s in segments], segments, face),
        OURS: lambda: _regional(face, rng),
    }
    return {name: make[name]() for name in names}


def flat_mesh(vertices: int) -> Mesh:
    """Return a mesh of vertices at random places; nothing here needs its triangles."""
    places = np.random.default_rng(1).normal(size=(vertices, 3)).astype(np.float32)
    faces, uv = np.array([[0, 1, 2]], np.int32), np.zeros((vertices, 2), np.float32)
    return Mesh(places, faces, uv, np.zeros(vertices, np.int32), ("face",))


def _segmented(networks: list, segments: list[Segment], face: Face) -> SegmentedModel:
    scale = np.ones(PARAMETERS, np.float32)
    return SegmentedModel(networks, segments, scale, [1.0] * len(segments), face.vertices)


def _line(segment: Segment) -> Line:
    line = Line(len(segment.parameters), len(segment.vertices))
    line.weight.normal_()
    return line


def _regional(face: Face, rng: np.random.Generator) -> RegionalModel:
    bases = list(_bases(face, rng))
    seen = [_some_parameters(rng) for _ in bases] if REGIONAL.by_region else [np.arange(PARAMETERS)]
    network = fresh_networks(seen, REGIONAL.hidden, [face.components] * len(bases), REGIONAL.gated, REGIONAL.line)
    with torch.no_grad():
        for weight in network.parameters():  # in 16 bits, as trainings leave them
            weight.copy_(weight.half().float())
    return RegionalModel(network, bases, np.ones(PARAMETERS, np.float32), 1.0, face.vertices)


def _some_parameters(rng: np.random.Generator) -> np.ndarray:
    return np.sort(rng.choice(PARAMETERS, SEEN, replace=False)).astype(np.int32)


def _bases(face: Face, rng: np.random.Generator) -> Iterator[StoredBasis]:
    fine = min(REGIONAL.fine, face.components)
    for region in np.array_split(np.arange(face.vertices, dtype=np.int32), REGIONAL.regions):
        beyond = min(round(RING * len(region) ** 0.5), face.vertices - len(region)) if REGIONAL.blend_rings else 0
        count = len(region) + beyond
        yield StoredBasis(
            torch.from_numpy((region[0] + np.arange(count, dtype=np.int32)) % face.vertices),
            torch.ones(count),
            torch.zeros(count, 3, dtype=torch.float16),
            torch.from_numpy(rng.integers(-9999, 9999, (fine, count, 3)).astype(np.int16)),
            torch.from_numpy(rng.integers(-99, 99, (face.components - fine, count, 3)).astype(np.int8)),
            torch.full((face.components,), 1e-4),
        )


ABOUT = "how the cost of a pose grows with vertices, segments, map size and components, each varied alone"
WRITES = "results/runs/bench/bench_growth.csv, bench_growth.png"
TABLE = "bench_growth"
RANDOM = "random"  # the character in rows
SIZES = {
    "vertices": (2_800, 5_600, 11_200, 22_400, 44_800),
    "segments": (1, 2, 4, 8, 16, 32),
    "map_size": (16, 32, 64, 128),
    "components": (24, 48, 96, 192, 384),
}
CONCERNED = {  # the methods whose cost depends on a size
    "vertices": (COARSE, DENSE, LINEAR, OURS),
    "segments": (COARSE, DENSE, LINEAR),
    "map_size": (COARSE,),
    "components": (OURS,),
}
EVALUATIONS = 100
MOVED = 0.25  # of the controls in a pose
POSES = 20


def measure(evaluations: int, sizes: dict[str, Sequence[int]] = SIZES) -> list[Row]:
    """Time all models of all sizes, and return the rows. sizes: the values of what is varied, by its name."""
    poses = random_poses()
    rows = []
    with confined(), progress(evaluations * len(sizes), "timing") as bar:
        for varied, values in sizes.items():
            ways = {
                f"{name} {metric_of(varied, value)}": Way(way)
                for value in values
                for name, way in ways_of(varied, value).items()
            }
            for name_and_metric, time in time_single_poses(ways, poses, evaluations, bar.update).items():
                name, metric = name_and_metric.split(" ")
                rows.append(bench_row(TABLE, RANDOM, name, metric, "ms", time.p05, time.evaluations))
    return rows


def metric_of(varied: str, value: int) -> str:
    """Return what the time is called where one size has a value and all others are usual."""
    return f"network[{varied}={value}]"


def random_poses() -> Float32[np.ndarray, "t m"]:
    """Return poses that each move some of the controls; the others are at zero."""
    rng = np.random.default_rng(2)
    poses = rng.uniform(-1, 1, (POSES, PARAMETERS))
    return np.where(rng.uniform(size=poses.shape) < MOVED, poses, 0).astype(np.float32)


def ways_of(varied: str, value: int) -> dict[str, Evaluate]:
    """Return the ways to evaluate the methods whose cost depends on a size, by method's name and ending."""
    face = replace(Face(), **{varied: value})
    mesh, ways = flat_mesh(face.vertices), {}
    for name, model in models_of(face, CONCERNED[varied]).items():
        by_ending = {PLAIN: plain_offsets(model), "": model.offsets if name == OURS else None}
        by_ending[FAST] = without_rigid_step(placing_of(model, mesh), mesh)
        ways |= {name + ending: way for ending, way in by_ending.items() if way}
    return ways


def growth_tables(rows: Sequence[Row]) -> list[Table]:
    """Return a table of milliseconds for each size that is varied."""
    tables = []
    for varied, values in SIZES.items():
        present = [value for value in values if any(row.metric == metric_of(varied, value) for row in rows)]
        names = in_table_order({r.method for r in rows if r.metric in {metric_of(varied, v) for v in present}})
        body = []
        for name in names:
            found = [find(rows, TABLE, RANDOM, name, metric_of(varied, value)) for value in present]
            body.append((label_of(name), *map(our_value, found)))
        title = f"Milliseconds a pose by {varied.replace('_', ' ')}"
        notes = ("Networks of random weights on one core, without the rigid step; 5th percentiles of the times.",)
        tables.append(Table(title, (("", *(f"{value:,}" for value in present)),), tuple(body), notes))
    return tables


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark from the command line; return the exit code."""
    parser = argparse.ArgumentParser(prog=f"python -m replicate.benchmarks.{TABLE}", description=ABOUT)
    add_count(parser, "rounds", EVALUATIONS, "poses that each is timed on")
    return answer(parser, _run, arguments)


def _run(options: argparse.Namespace, command_line: Sequence[str]) -> None:
    rows = measure(options.rounds)
    publish(TABLE, rows, growth_tables(rows), command_line)
    save_picture(TABLE, growth_figure(rows))


# The times as a figure of four panels, one for each size that is varied; a method has one colour.

HEIGHT = 8.4  # inches
LABELS = {
    "vertices": "vertices",
    "segments": "segments",
    "map_size": "pixels a side of a map",
    "components": "components a region",
}
USUAL = vars(Face())
STYLES = {PLAIN: (":", "v"), "": ("--", "^"), FAST: ("-", "o")}
KEYS = {PLAIN: "plain torch", "": "the suite's torch", FAST: "fast"}


def growth_figure(rows: Sequence[Row]) -> "tuple[matplotlib.figure.Figure, Words]":
    """Return (figure, words): `bench_growth`'s times, a panel for each size that is varied."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    figure = Figure((WIDTH, HEIGHT), dpi=DPI, layout="constrained")
    panels = figure.subplots(2, 2, sharey=True)
    phrases = []
    # a panel for each size: milliseconds against its values
    for axes, (varied, label) in zip(panels.flat, LABELS.items(), strict=True):
        lines = _lines(rows, varied)
        for name, points in lines.items():
            method, ending = parted(name)
            style, marker = STYLES[ending]
            colour = method_named(method).colour
            axes.plot(*zip(*points, strict=True), style, marker=marker, color=colour, linewidth=2.2, markersize=8)
            (low, least), (high, most) = points[0], points[-1]
            words = f"{method_named(method).label}, {BACKENDS[ending]}"
            phrases.append(
                f"{words}, {low:,} to {high:,} {label}: {round_off(least, 'ms')} to {round_off(most, 'ms')} ms"
            )
        axes.axvline(USUAL[varied], color="0.55", linewidth=1.2, linestyle=(0, (1, 3)), zorder=1)
        values = [value for value, _ in next(iter(lines.values()))]
        axes.set_xscale("log", base=2)
        unit = 1_000 if values[0] >= 1_000 else 1
        axes.set_xticks(values, [f"{value / unit:g}" for value in values])
        axes.set_xlabel(f"thousand {label}" if unit > 1 else label)
    # one scale and one style for all panels
    error_scale(panels[0, 0], "y")
    for axes in panels.flat:
        tidy(axes)
        enlarge(axes)
    for axes in panels[:, 0]:
        axes.set_ylabel("milliseconds a pose")
        enlarge(axes)
    # a legend of methods by colour and of ways by line
    names = in_table_order({row.method for row in rows})
    methods = list(dict.fromkeys(parted(name)[0] for name in names))
    endings = [ending for ending in STYLES if any(parted(name)[1] == ending for name in names)]
    keys = [Line2D([], [], color=method_named(method).colour, linewidth=4) for method in methods]
    keys += [Line2D([], [], color="0.35", linestyle=STYLES[e][0], marker=STYLES[e][1], markersize=8) for e in endings]
    labels = [method_named(method).label for method in methods] + [KEYS[ending] for ending in endings]
    figure.legend(keys, labels, loc="outside upper center", ncols=4, frameon=False, fontsize=15.5)
    return figure, Words(
        f"Four line charts of milliseconds a pose on one core. {'; '.join(phrases)}.",
        "How the cost of a pose grows: networks of random weights on one core; both axes are logarithmic. In each "
        "panel one size is varied; the dotted line is about where teen is.",
    )


def _lines(rows: Sequence[Row], varied: str) -> dict[str, list[tuple[int, float]]]:
    """Return the points (size, milliseconds) of one panel by name, from the least size on."""
    start = f"network[{varied}="
    lines: dict[str, list[tuple[int, float]]] = {}
    for row in rows:
        if row.metric.startswith(start):
            lines.setdefault(row.method, []).append((int(row.metric.removeprefix(start).rstrip("]")), row.value))
    return {name: sorted(lines[name]) for name in in_table_order(lines)}


if __name__ == "__main__":
    sys.exit(main())
