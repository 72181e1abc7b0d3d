"""How the cost of a pose grows with vertices, segments, map size and components: each varied alone, on one core.

`make bench-growth` needs no character and no training. Weights are random and have the right shapes; times do not
depend on what they are, but for rows of zero parameters, which the fast evaluation leaves out. A pose here moves a
quarter of its controls. All else is about as large as it is for `teen`. Networks alone are timed, without the rigid
step.
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float32

from replicate.benchmarks.common import PROFILE, add_count, answer, bench_folder, publish
from replicate.benchmarks.growth_models import COARSE, DENSE, LINEAR, OURS, PARAMETERS, Face, flat_mesh, models_of
from replicate.engine.progress import progress
from replicate.geometry.mesh import Mesh
from replicate.inference.fast_evaluation import placing_of
from replicate.methods.method import Model
from replicate.report.results import Row, find
from replicate.report.tables import Table, round_off
from replicate.timing.cores import can_confine, one_core, threads
from replicate.timing.plain_evaluation import plain_offsets
from replicate.timing.single_poses import Evaluate, Way, time_single_poses
from replicate.timing.timed_names import FAST, PLAIN, in_table_order, label_of

ABOUT = "how the cost of a pose grows with vertices, segments, map size and components, each varied alone"
WRITES = "results/runs/bench/bench_growth.csv, bench_growth.png"
TABLE = "bench_growth"
RANDOM = "random"  # what rows have for a character
SIZES = {
    "vertices": (2_800, 5_600, 11_200, 22_400, 44_800),
    "segments": (1, 2, 4, 8, 16, 32),
    "map_size": (16, 32, 64, 128),
    "components": (24, 48, 96, 192, 384),
}
CONCERNED = {  # the methods that a size is a matter for
    "vertices": (COARSE, DENSE, LINEAR, OURS),
    "segments": (COARSE, DENSE, LINEAR),
    "map_size": (COARSE,),
    "components": (OURS,),
}
EVALUATIONS = 100
MOVED = 0.25  # of the controls in a pose
POSES = 20


def measure(evaluations: int, sizes: dict[str, Sequence[int]] = SIZES) -> list[Row]:
    """Time all models of all sizes, and return the rows. sizes: by what is varied."""
    poses = random_poses()
    rows = []
    with one_core() if can_confine() else threads(1), progress(evaluations * len(sizes), "timing") as bar:
        for varied, values in sizes.items():
            found = {metric_of(varied, value): ways_of(varied, value) for value in values}
            ways = {f"{name} {metric}": Way(way) for metric, own in found.items() for name, way in own.items()}
            times = time_single_poses(ways, poses, evaluations, bar.update)
            rows += [
                Row(TABLE, RANDOM, name, metric, "ms", time.p05, None, 1, time.evaluations, PROFILE, RANDOM)
                for metric, own in found.items()
                for name in own
                for time in (times[f"{name} {metric}"],)
            ]
    return rows


def metric_of(varied: str, value: int) -> str:
    """Return the metric of a time where one size has a value and all others are usual."""
    return f"network[{varied}={value}]"


def random_poses() -> Float32[np.ndarray, "t m"]:
    """Return poses that each move some of the controls; the others are at zero."""
    rng = np.random.default_rng(2)
    poses = rng.uniform(-1, 1, (POSES, PARAMETERS))
    return np.where(rng.uniform(size=poses.shape) < MOVED, poses, 0).astype(np.float32)


def ways_of(varied: str, value: int) -> dict[str, Evaluate]:
    """Return by name, method and ending, the ways to evaluate what a size is a matter for."""
    face = replace(Face(), **{varied: value})
    mesh, ways = flat_mesh(face.vertices), {}
    for name, model in models_of(face, CONCERNED[varied]).items():
        found = {PLAIN: plain_offsets(model), "": model.offsets if name == OURS else None, FAST: _fast(model, mesh)}
        ways |= {name + ending: way for ending, way in found.items() if way}
    return ways


def _fast(model: Model, mesh: Mesh) -> Callable[[np.ndarray], np.ndarray]:
    placing, out = placing_of(model, mesh), np.array(mesh.neutral)

    def evaluate(pose: np.ndarray) -> np.ndarray:
        np.copyto(out, mesh.neutral)
        placing.place(pose[0], out)
        return out

    return evaluate


def growth_tables(rows: Sequence[Row]) -> list[Table]:
    """Return a table of milliseconds for each size that is varied."""
    tables = []
    for varied, values in SIZES.items():
        present = [value for value in values if any(row.metric == metric_of(varied, value) for row in rows)]
        names = in_table_order({r.method for r in rows if r.metric in {metric_of(varied, v) for v in present}})
        body = []
        for name in names:
            found = [find(rows, TABLE, RANDOM, name, metric_of(varied, value)) for value in present]
            body.append((label_of(name), *(round_off(row.value, "ms") if row else "–" for row in found)))
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
    from replicate.benchmarks.growth_figure import growth_figure
    from replicate.drawing.panels import save_figure

    rows = measure(options.rounds)
    publish(TABLE, rows, growth_tables(rows), command_line)
    figure, words = growth_figure(rows)
    save_figure(figure, bench_folder() / f"{TABLE}.png", words)


if __name__ == "__main__":
    sys.exit(main())
