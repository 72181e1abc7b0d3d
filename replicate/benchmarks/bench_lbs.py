"""Our SSDR and Dem Bones on the same poses: errors on held-out poses, time, memory.

`make bench-lbs` draws training poses of a character (Eq. 5; a seed each time) and test poses, fits both methods until
they have converged by one rule, refits both on the same test poses in the same way (`ssdr.refit`), and measures. Each
fit runs in a process of its own, one after the other, on one thread, and its time is that of the processor: other work
on the machine changes it little. Finished fits stay: the same command goes on from there.
"""

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from data_recipes.rig import Rig
from replicate.benchmarks.common import (
    PROFILE,
    add_count,
    bench_folder,
    make_parser,
    merge,
    note,
    parse,
    split_names,
)
from replicate.benchmarks.lbs_comparison import EQUAL, METHODS, lbs_table
from replicate.config import SamplesConfig
from replicate.engine.command_line import guard
from replicate.engine.exceptions import RunError
from replicate.engine.provenance import peak_memory_mb
from replicate.engine.stage import stream_rng
from replicate.engine.worker_process import thread_limits
from replicate.report.results import Row, read_results
from replicate.report.tables import as_text

if TYPE_CHECKING:
    import replicate.approximation.skinning.alternation
    import replicate.approximation.skinning.compression
    import replicate.approximation.skinning.ssdr

ABOUT = "our SSDR beside Dem Bones (pip install py-dem-bones) on the same poses"
WRITES = "results/runs/bench/bench_lbs.csv"
TABLE = "bench_lbs"
OURS = {"ssdr": None, "ssdr_sparse": 0}  # relaxed iterations; None: as usual
BONES, SEEDS = (16, 24, 32), (0, 1, 2)
TRAINING, TEST = 1_000, 200
MOST, LEAST = 200, 30  # iterations
WINDOW, LEAST_GAIN = 10, 0.002  # converged: the last so many iterations lowered the RMSE by less than this share
METRICS = {
    "rmse": "mm", "mean": "mm", "normal": "deg", "max": "mm", "training_rmse": "mm", "iterations": "count",
    "time": "ms", "time_at_equal_iterations": "ms", "time_to_dem_bones_error": "ms", "peak_memory": "MB",
    "bones_of_own_start": "count",
}  # fmt: skip


@dataclass
class Course:
    """How a fit goes: seconds and training RMSE in mm after each iteration, and whether it has converged."""

    seconds: list[float]
    rmse: list[float]

    def go_on(self, iteration: int, seconds: float, rmse: float) -> bool:
        """Note one iteration and return whether another should follow."""
        self.seconds.append(seconds)
        self.rmse.append(rmse)
        if iteration < LEAST:
            return True
        return iteration < MOST and min(self.rmse[-WINDOW:]) < (1 - LEAST_GAIN) * min(self.rmse[:-WINDOW])

    def time_to(self, rmse: float) -> float:
        """Return the seconds after which the error was no larger than this; infinite if it never was."""
        return next((s for s, r in zip(self.seconds, self.rmse, strict=True) if r <= rmse), math.inf)


def fit_ours(
    neutral: np.ndarray,
    vertices: np.ndarray,
    faces: np.ndarray,
    bones: int,
    seed: int,
    course: Course,
    relaxed: int | None = None,
) -> "replicate.approximation.skinning.ssdr.Skin":
    """Fit as `ssdr.fit` does with its usual settings, an iteration at a time; notes cost no time.

    relaxed: iterations in which all bones may act; the usual number by default.
    """
    from replicate.approximation.skinning.compression import canonical_order, compress
    from replicate.approximation.skinning.relaxation import alternation
    from replicate.approximation.skinning.ssdr import check, skin_of
    from replicate.config import LbsConfig

    usual = LbsConfig()
    start = time.process_time()
    check(neutral, vertices, bones, usual.influences)
    vertex_order, pose_order = canonical_order(neutral, vertices)
    rest, ranks = neutral[vertex_order], np.argsort(vertex_order)
    data = compress(rest, vertices[pose_order[:, None], vertex_order[None]], stream_rng(seed, "lbs", "sketch"))
    relaxed = usual.relaxed if relaxed is None else relaxed
    way = alternation(data, ranks[faces], usual.coherence, usual.influences, relaxed)
    state = way.start(bones)
    for _ in range(way.relaxed):
        state = way.step(state)
    seconds = time.process_time() - start
    while course.go_on(state.iteration - way.relaxed, seconds, training_rmse(data, state)):
        start = time.process_time()
        state = way.step(state)
        seconds += time.process_time() - start
    return skin_of(neutral, vertex_order, state)


def training_rmse(
    data: "replicate.approximation.skinning.compression.CompressedPoses",
    state: "replicate.approximation.skinning.alternation.State",
) -> float:
    """Return the root of the mean squared distance over vertices and poses, in mm."""
    from scipy.sparse import eye_array

    from replicate.approximation.skinning.alternation import Problem, normal_equations
    from replicate.approximation.skinning.edge_metric import Metric

    n, bones = len(data.points), state.motion.shape[2]
    plain = Metric(eye_array(n, format="csr"), eye_array(n, format="csr"), ())
    uu, vu = normal_equations(Problem(data, plain), state.bone_index, state.weights, bones)
    flat = state.motion.reshape(3 * data.frames, -1)
    whole = np.sum(data.coefficients**2) / (1 - data.lost**2)  # what compression left out is an error too
    squared = whole - 2 * np.sum(flat * vu.reshape(flat.shape)) + np.sum((flat.T @ flat) * uu)
    return data.radius_mm * math.sqrt(max(float(squared), 0.0) / (n * data.frames))


def held_out(
    skin: "replicate.approximation.skinning.ssdr.Skin", truth: np.ndarray, faces: np.ndarray
) -> dict[str, float]:
    """Return the errors of a skin that is refitted to test poses."""
    from replicate.approximation.metrics import normal_error, vertex_error
    from replicate.approximation.skinning.ssdr import refit

    posed = skin.deform(*refit(skin, truth))
    distance = vertex_error(posed, truth).astype(np.float64)
    return {
        "rmse": float(np.sqrt((distance**2).mean())),
        "mean": float(distance.mean()),
        "max": float(distance.max()),
        "normal": float(np.nanmean(normal_error(posed, truth, faces), dtype=np.float64)),
    }


def one_fit(folder: Path, method: str, bones: int, seed: int) -> None:
    """Fit and measure one method on the poses in a folder; write the errors beside them, as JSON."""
    from replicate.benchmarks import dem_bones

    with np.load(folder / "poses.npz", allow_pickle=False) as stored:
        neutral, faces, training, test = (stored[name] for name in ("neutral", "faces", "training", "test"))
    course, more = Course([], []), {}
    if method in OURS:
        compile_kernels()
        skin = fit_ours(neutral, training, faces, bones, seed, course, OURS[method])
    else:
        options = dem_bones.BEST if method == "dem_bones" else dem_bones.DEFAULT
        skin, more["bones_of_own_start"] = dem_bones.fit(neutral, training, faces, bones, options, course.go_on)
    peak = peak_memory_mb()  # the test poses' refit is not the fit's
    more |= {"seconds": course.seconds, "rmse_course": course.rmse, "peak_mb": peak}
    results = held_out(skin, test, faces) | more
    (folder / f"{method}.json").write_text(json.dumps(results))


def compile_kernels() -> None:
    """Fit a sheet of a few vertices, so that no time goes into compiling."""
    from replicate.approximation.skinning.ssdr import fit

    x, y = np.meshgrid(np.arange(6.0), np.arange(6.0))
    neutral = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], 1).astype(np.float32)
    rng = np.random.default_rng(0)
    poses = neutral + rng.normal(size=(5, 36, 3)).astype(np.float32)
    fit(neutral, poses, 4, rng, iterations=2, faces=np.int32([[0, 1, 7], [0, 7, 6]]))


def write_poses(rig: Rig, seed: int, training: int, test: int, file: Path) -> None:
    """Write a character's training and test poses for one seed, in mm."""
    from replicate.approximation.samples import choose_poses, evaluate

    poses = choose_poses(rig, SamplesConfig(count=training), lambda name: stream_rng(seed, "samples", name))
    unique = np.unique(poses["test"], axis=0)
    choice = unique[np.sort(stream_rng(seed, "lbs", "test").permutation(len(unique))[:test])]
    posed = {
        part: np.concatenate([vertices for _, vertices in evaluate(rig, params)])
        for part, params in (("training", poses["training"]), ("test", choice))
    }
    np.savez(file, neutral=rig.mesh.neutral, faces=rig.mesh.faces, **posed)


def rows_of_character(character: str, options: argparse.Namespace, file: Path) -> list[Row]:
    """Fit all methods at all numbers of bones and seeds that the file lacks, and return all rows of this character."""
    from replicate.artefacts.built_rig import rig_identifier, rig_of

    rig, run = rig_of(character), rig_identifier(character)
    for seed in options.seeds:
        with tempfile.TemporaryDirectory(prefix="bench-lbs-") as name:
            folder, missing = Path(name), _missing(file, rig.name, run, seed, options)
            if missing:
                write_poses(rig, seed, options.training, options.test, folder / "poses.npz")
            for bones, method in missing:
                print(f"{rig.name}, {bones} bones, seed {seed}: {METHODS[method]} …", file=sys.stderr, flush=True)
                command = [sys.executable, "-m", __spec__.name, "--fit", str(folder), method, str(bones), str(seed)]
                if subprocess.run(command, check=False, env=os.environ | thread_limits(1)).returncode:
                    raise RunError(f"{METHODS[method]}, {bones} bones, seed {seed}: the fit failed; see above")
                results = json.loads((folder / f"{method}.json").read_text())
                own = method == "dem_bones"
                reach = min(results["rmse_course"]) if own else _peer_error(file, rig.name, run, bones, seed)
                _keep(file, rows_of(rig.name, method, bones, seed, run, results, reach, options.test))
    return [row for row in read_results(file) if row.character == rig.name]


def _missing(file: Path, character: str, run: str, seed: int, options: argparse.Namespace) -> list[tuple[int, str]]:
    """Return the numbers of bones and methods without numbers of this rig and seed, the peers' first."""
    entries = {(row.method, row.metric) for row in _read_rows(file) if (row.character, row.run) == (character, run)}
    methods = sorted(options.methods, key=lambda method: method in OURS)  # ours is timed against the peer's error
    return [(b, m) for b in options.bones for m in methods if (m, f"rmse[{b}, seed {seed}]") not in entries]


def _peer_error(file: Path, character: str, run: str, bones: int, seed: int) -> float:
    """Return the training error that Dem Bones reached; zero, which nothing reaches, if that isn't done."""
    key = (character, run, "dem_bones", f"training_rmse[{bones}, seed {seed}]")
    return next((r.value for r in _read_rows(file) if (r.character, r.run, r.method, r.metric) == key), 0.0)


def _read_rows(file: Path) -> list[Row]:
    return read_results(file) if file.is_file() else []


def _keep(file: Path, rows: Sequence[Row]) -> None:
    """Put rows into the file, in place of those about the same things; another rig's numbers go."""
    runs = {(row.character, row.run) for row in rows}
    names = {character for character, _ in runs}
    merge(file, rows, lambda row: row.character not in names or (row.character, row.run) in runs)


def rows_of(
    character: str, method: str, bones: int, seed: int, run: str, results: dict, peer_error: float, poses: int
) -> list[Row]:
    """Return one fit's numbers as rows; times in ms. peer_error: Dem Bones' training RMSE, mm."""
    course = Course(results["seconds"], results["rmse_course"])
    values = {
        name: results[name] for name in ("rmse", "mean", "normal", "max", "bones_of_own_start") if name in results
    }
    values |= {
        "training_rmse": min(course.rmse),
        "iterations": len(course.rmse) - 1,
        "time": 1e3 * course.seconds[-1],
        "time_at_equal_iterations": 1e3 * course.seconds[min(EQUAL, len(course.seconds) - 1)],
        "peak_memory": results["peak_mb"],
    }
    seconds = course.time_to(peer_error)
    if math.isfinite(seconds):
        values["time_to_dem_bones_error"] = 1e3 * seconds
    return [
        Row(TABLE, character, method, f"{name}[{bones}, seed {seed}]", METRICS[name], float(value), None, 1,
            poses, PROFILE, run)
        for name, value in values.items()
    ]  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark from the command line; return the exit code."""
    parser = make_parser("bench_lbs", __doc__, "teen, dragon")
    parser.add_argument("--bones", type=int, nargs="+", default=BONES, help="numbers of bones (default: 16 24 32)")
    parser.add_argument("--seeds", type=int, nargs="+", default=SEEDS, help="seeds of the poses (default: 0 1 2)")
    parser.add_argument("--methods", nargs="+", default=tuple(METHODS), choices=METHODS, help="default: all")
    add_count(parser, "training", TRAINING, "training poses")
    add_count(parser, "test", TEST, "held-out poses")
    parser.add_argument("--fit", nargs=4, metavar=("FOLDER", "METHOD", "BONES", "SEED"), help=argparse.SUPPRESS)
    options, command_line = parse(parser, arguments)
    if options.fit:
        folder, method, bones, seed = options.fit
        one_fit(Path(folder), method, int(bones), int(seed))
        return 0
    return guard(partial(_run, options, command_line))


def _run(options: argparse.Namespace, command_line: Sequence[str]) -> None:
    from replicate.benchmarks.dem_bones import solver_class

    if any(method not in OURS for method in options.methods):
        solver_class()
    for character in split_names(options.characters):
        rows = rows_of_character(character, options, bench_folder() / "bench_lbs.csv")
        print(as_text(lbs_table(rows, rows[0].character)) + "\n")
        note("bench_lbs", [rows[0].character], command_line, options.seeds)


if __name__ == "__main__":
    sys.exit(main())
