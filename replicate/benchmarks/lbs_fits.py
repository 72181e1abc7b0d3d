"""One fit of a skin to poses, ours or Dem Bones', with its errors on other poses, its time and its memory.

It is a program, `python -m replicate.benchmarks.lbs_fits FOLDER METHOD BONES SEED`, so that the memory of a process is
that of one fit.
"""

import json
import math
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.sparse import eye_array

from data_recipes.rig import Rig
from replicate.approximation.metrics import normal_error, vertex_error
from replicate.approximation.samples import choose_poses, evaluate
from replicate.baselines.skinning.alternation import Problem, State, normal_equations
from replicate.baselines.skinning.compression import CompressedPoses, Metric, canonical_order, compress
from replicate.baselines.skinning.ssdr import Skin, check, fit, refit, skin_of
from replicate.baselines.skinning.starts import alternation
from replicate.config import LbsConfig, SamplesConfig
from replicate.engine.provenance import peak_memory_mb
from replicate.engine.stage import stream_rng

OURS = {"ssdr": None, "ssdr_sparse": 0}  # method → relaxed iterations; None for the usual count
MOST, LEAST = 200, 30  # iterations
WINDOW, LEAST_GAIN = 10, 0.002  # converged: the last so many iterations lowered the RMSE by less than this share


def write_poses(rig: Rig, seed: int, training: int, test: int, file: Path) -> None:
    """Write a character's training and test poses to a file, in mm.

    rig: the character's.
    seed: of the poses.
    training, test: how many.
    file: an .npz file.
    """
    poses = choose_poses(rig, SamplesConfig(count=training), lambda name: stream_rng(seed, "samples", name))
    unique = np.unique(poses["test"], axis=0)
    choice = unique[np.sort(stream_rng(seed, "lbs", "test").permutation(len(unique))[:test])]
    posed = {
        part: np.concatenate([vertices for _, vertices in evaluate(rig, params)])
        for part, params in (("training", poses["training"]), ("test", choice))
    }
    np.savez(file, neutral=rig.mesh.neutral, faces=rig.mesh.faces, **posed)


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
) -> Skin:
    """Fit as `ssdr.fit` does with its usual settings, an iteration at a time; only the fit itself is timed.

    neutral: rest positions (n, 3), mm.
    vertices: the poses (f, n, 3), mm.
    faces: (t, 3).
    bones: how many.
    seed: of the compression.
    course: notes each iteration and says when to end.
    relaxed: iterations in which all bones may act; None for the usual count.
    """
    usual = LbsConfig()
    start = time.process_time()
    check(neutral, vertices, bones, usual.influences)
    vertex_order, pose_order = canonical_order(neutral, vertices)
    rest, ranks = neutral[vertex_order], np.argsort(vertex_order)
    data = compress(rest, vertices[pose_order[:, None], vertex_order[None]], stream_rng(seed, "lbs", "sketch"))
    relaxed = usual.relaxed if relaxed is None else relaxed
    course_of_fit = alternation(data, ranks[faces], usual.coherence, usual.influences, relaxed)
    state = course_of_fit.start(bones)
    for _ in range(course_of_fit.relaxed):
        state = course_of_fit.step(state)
    seconds = time.process_time() - start
    while course.go_on(state.iteration - course_of_fit.relaxed, seconds, training_rmse(data, state)):
        start = time.process_time()
        state = course_of_fit.step(state)
        seconds += time.process_time() - start
    return skin_of(neutral, vertex_order, state)


def training_rmse(data: CompressedPoses, state: State) -> float:
    """Return the root of the mean squared distance over vertices and poses, in mm."""
    n, bones = len(data.points), state.motion.shape[2]
    plain = Metric(eye_array(n, format="csr"), eye_array(n, format="csr"), ())
    uu, vu = normal_equations(Problem(data, plain), state.bone_index, state.weights, bones)
    flat = state.motion.reshape(3 * data.frames, -1)
    whole = np.sum(data.coefficients**2) / (1 - data.lost**2)  # what compression left out is an error too
    squared = whole - 2 * np.sum(flat * vu.reshape(flat.shape)) + np.sum((flat.T @ flat) * uu)
    return data.radius_mm * math.sqrt(max(float(squared), 0.0) / (n * data.frames))


def held_out(skin: Skin, truth: np.ndarray, faces: np.ndarray) -> dict[str, float]:
    """Return the errors of a skin that is refitted to test poses."""
    posed = skin.deform(*refit(skin, truth))
    distance = vertex_error(posed, truth).astype(np.float64)
    return {
        "rmse": float(np.sqrt((distance**2).mean())),
        "mean": float(distance.mean()),
        "max": float(distance.max()),
        "normal": float(np.nanmean(normal_error(posed, truth, faces), dtype=np.float64)),
    }


def compile_kernels() -> None:
    """Fit a sheet of a few vertices, so that no timed fit compiles."""
    x, y = np.meshgrid(np.arange(6.0), np.arange(6.0))
    neutral = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], 1).astype(np.float32)
    rng = np.random.default_rng(0)
    poses = neutral + rng.normal(size=(5, 36, 3)).astype(np.float32)
    fit(neutral, poses, 4, rng, iterations=2, faces=np.int32([[0, 1, 7], [0, 7, 6]]))


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


if __name__ == "__main__":
    folder, method, bones, seed = sys.argv[1:]
    one_fit(Path(folder), method, int(bones), int(seed))
