"""How fast the rigs are: batched, one pose at a time, and node by node as a production engine runs them.

`make bench-rig` prints milliseconds a pose and poses a second, with ratios of the ways to call the same deformers, and
writes bench_rig.csv. The ways take turns within a round, so that a busy machine slows all of them alike; the median of
the rounds counts. All threads of the machine are used, unlike in a stage.
"""

import argparse
import sys
import time
from collections.abc import Callable, Sequence

import numpy as np

from replicate import paths
from replicate.errors import InputError, RunError
from replicate.evaluation.results import Row, write_results
from replicate.evaluation.tables import Table, as_text
from replicate.made import made_rig
from replicate.progress import progress

BATCH = 32
APART = 4  # poses that a round evaluates one by one
ROUNDS = 15
POSES = {"batched": BATCH, "single": APART, "nodes": APART, "nodes_batched": BATCH}  # that each way evaluates a round


def timed(ways: dict[str, Callable[[], object]], rounds: int) -> dict[str, np.ndarray]:
    """Return the seconds that each way took in each round; one unmeasured round comes first, to compile."""
    seconds = {name: np.empty(rounds) for name in ways}
    with progress((rounds + 1) * len(ways), "timing") as bar:
        for r in range(-1, rounds):
            for name, call in ways.items():
                started = time.perf_counter()
                call()
                if r >= 0:
                    seconds[name][r] = time.perf_counter() - started
                bar.update(1)
    return seconds


def bench(rig, params: np.ndarray, rounds: int) -> dict[str, float]:
    """Return milliseconds a pose of each way to call a rig, and the worst batch's; params: (BATCH, m)."""
    single, poses = params[:1], [params[k : k + 1] for k in range(APART)]
    ways = {
        "batched": lambda: rig(params),
        "single": lambda: [rig(pose) for pose in poses],
        "nodes": lambda: [rig.run_nodes(pose) for pose in poses],
        "nodes_batched": lambda: rig.run_nodes(params),
    }
    found = timed(ways, rounds)
    result = {name: 1e3 * float(np.median(found[name])) / POSES[name] for name in ways}
    result["batched_worst"] = 1e3 * float(found["batched"].max()) / BATCH
    difference = float(np.abs(rig(single) - rig.run_nodes(single)).max())
    result["nodes_difference_mm"] = difference
    return result


def rows(character: str, found: dict[str, float]) -> list[Row]:
    """Return the numbers of one character as rows, ratios as rows of their own; `poses` are those of a round."""

    def row(method: str, metric: str, unit: str, value: float) -> Row:
        poses = 1 if metric == "largest_difference" else min(POSES[way] for way in method.split("/"))
        return Row("bench_rig", character, method, metric, unit, value, None, None, poses, "bench", "bench-rig")

    listed = [row(way, "time_per_pose", "ms", found[way]) for way in ("batched", "single", "nodes", "nodes_batched")]
    listed += [row(way, "poses_per_second", "count", 1e3 / found[way]) for way in ("batched", "single", "nodes")]
    listed.append(row("batched", "worst_time_per_pose", "ms", found["batched_worst"]))
    listed.append(row("nodes", "largest_difference", "mm", found["nodes_difference_mm"]))
    listed.append(row("single/batched", "time_ratio", "ratio", found["single"] / found["batched"]))
    listed.append(row("nodes/single", "time_ratio", "ratio", found["nodes"] / found["single"]))
    return listed


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark from the command line; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m replicate.benchmarks.rig", description="Time the rigs.")
    parser.add_argument("--characters", default="teen", help="names or recipes, separated by commas (default: teen)")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help=f"how often each way is timed (default: {ROUNDS})")
    options = parser.parse_args(arguments)
    try:
        if options.rounds < 3:
            raise InputError(f"rounds is {options.rounds}: allowed is a whole number of at least 3")
        listed, lines = [], []
        for character in options.characters.replace(",", " ").split():
            rig = made_rig(character)
            found = bench(rig, _poses(rig), options.rounds)
            listed += rows(rig.name, found)
            times = [f"{found[way]:.2f}" for way in ("batched", "batched_worst", "single", "nodes")]
            ratios = [f"{found['single'] / found['batched']:.1f}", f"{found['nodes'] / found['single']:.1f}"]
            lines.append((rig.name, *times, f"{1e3 / found['batched']:.0f}", *ratios))
    except (InputError, RunError) as error:
        print(error, file=sys.stderr)
        return 2 if isinstance(error, InputError) else 1
    header = ("", "batched", "worst batch", "single", "node by node", "poses/s", "single/batched", "nodes/single")
    note = f"ms a pose; batches of {BATCH} frames of the clips; median of {options.rounds} rounds of all ways in turn."
    print(as_text(Table("Rigs: time of one pose", (header,), tuple(lines), (note,))))
    folder = paths.run_folder("bench")
    folder.mkdir(parents=True, exist_ok=True)
    write_results(folder / "bench_rig.csv", listed)
    return 0


def _poses(rig) -> np.ndarray:
    """Return BATCH poses (BATCH, m): frames of the clips, or uniform ones for a rig without clips."""
    generator = np.random.default_rng(0)
    if not rig.clips:
        return generator.uniform(rig.lower, rig.upper, (BATCH, len(rig.controls))).astype(np.float32)
    frames = np.concatenate([clip.values for clip in rig.clips])
    return frames[generator.choice(len(frames), BATCH)].astype(np.float32)


if __name__ == "__main__":
    sys.exit(main())
