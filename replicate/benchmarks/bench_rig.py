"""How fast the rigs are: batched, one pose at a time, and node by node as a production engine runs them.

`make bench-rig` prints milliseconds a pose, ratios of the ways to call the same deformers, and each deformer's share of
the node-by-node evaluation, and writes bench_rig.csv. The ways take turns within a round, so that a busy machine slows
all of them alike; the median of the rounds counts. All threads of the machine are used, unlike in a stage. Processor
time counts all threads and no other process, so compare that on a busy machine.
"""

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from data_recipes.rig import BATCH, Rig
from replicate.base.exceptions import InputError
from replicate.base.progress import progress
from replicate.benchmarks.common import PROFILE, add_count, answer, make_parser, publish, split_names
from replicate.methods.artefacts import rig_of
from replicate.report.results import Row, cast, order_of, read_results
from replicate.report.tables import Table

ABOUT = "poses per second of all rigs, batched and one at a time, and each deformer's share"
WRITES = "results/runs/bench/bench_rig.csv"
APART = 4  # poses that a round evaluates one by one
ROUNDS = 15
POSES = {"batched": BATCH, "single": APART, "nodes": APART, "nodes_batched": BATCH}  # that each way evaluates a round
DATA_SET = 50_000  # poses of the profile "paper"
RATIOS = ("single/batched", "nodes/single", "nodes_batched/batched")


def time_ways(ways: dict[str, Callable[[], object]], rounds: int) -> dict[str, np.ndarray]:
    """Return each way's wall time and processor time in each round, (rounds, 2) seconds.

    One unmeasured round comes first, to compile.
    """
    seconds = {name: np.empty((rounds, 2)) for name in ways}
    with progress((rounds + 1) * len(ways), "timing") as bar:
        for r in range(-1, rounds):
            for name, call in ways.items():
                start = np.array([time.perf_counter(), time.process_time()])
                call()
                if r >= 0:
                    seconds[name][r] = np.array([time.perf_counter(), time.process_time()]) - start
                bar.update(1)
    return seconds


def time_nodes(rig: Rig, params: np.ndarray, into: dict[str, float]) -> None:
    """Run a rig's nodes one by one and add to each name's entry how many seconds it took."""
    start = time.perf_counter()
    for name, _ in rig.node_steps(params):
        end = time.perf_counter()
        into[name] = into.get(name, 0.0) + end - start
        start = end


def bench(rig: Rig, params: np.ndarray, rounds: int) -> dict[str, float]:
    """Return milliseconds a pose by name: of each way to call a rig, by the clock and by processor time, of each node
    in both ways to run nodes, and of the worst batch; also how far the nodes' vertices are from the rig's, mm.

    params: (BATCH, m).
    """
    single, poses = params[:1], [params[k : k + 1] for k in range(APART)]
    parts: dict[str, list[dict[str, float]]] = {"nodes": [], "nodes_batched": []}

    def by_node(way: str, batches: Sequence[np.ndarray]) -> None:
        parts[way].append({})
        for batch in batches:
            time_nodes(rig, batch, parts[way][-1])

    ways = {
        "batched": lambda: rig(params),
        "single": lambda: [rig(pose) for pose in poses],
        "nodes": lambda: by_node("nodes", poses),
        "nodes_batched": lambda: by_node("nodes_batched", [params]),
    }
    seconds_of = time_ways(ways, rounds)
    result = {}
    for way in ways:
        wall, processor = 1e3 * np.median(seconds_of[way], axis=0) / POSES[way]
        result |= {way: float(wall), f"{way} processor": float(processor)}
    for way, rounds_of in parts.items():
        for name in rounds_of[-1]:
            middle = np.median([seconds[name] for seconds in rounds_of[1:]])  # the first round compiled
            result[f"{way}[{name}]"] = 1e3 * float(middle) / POSES[way]
    result["batched_worst"] = 1e3 * float(seconds_of["batched"][:, 0].max()) / BATCH
    result["nodes_difference_mm"] = float(np.abs(rig(single) - rig.run_nodes(single)).max())
    return result


def shares(times: dict[str, float], way: str) -> dict[str, float]:
    """Return each node's share of a way to run nodes, "nodes" or "nodes_batched"; they sum to 1."""
    of_nodes = {key[len(way) + 1 : -1]: value for key, value in times.items() if key.startswith(f"{way}[")}
    return {name: value / sum(of_nodes.values()) for name, value in of_nodes.items()}


def rows(character: str, times: dict[str, float]) -> list[Row]:
    """Return the times of one character and their ratios as rows, whose poses are those of a round."""

    def row(method: str, metric: str, unit: str, value: float) -> Row:
        poses = 1 if metric == "largest_difference" else min(POSES[way] for way in method.split("/"))
        return Row("bench_rig", character, method, metric, unit, value, None, None, poses, PROFILE, "bench-rig")

    rows = [row(way, "time_per_pose", "ms", times[way]) for way in POSES]
    rows += [row(way, "processor_time_per_pose", "ms", times[f"{way} processor"]) for way in POSES]
    rows += [row(way, "poses_per_second", "count", 1e3 / times[way]) for way in POSES]
    rows.append(row("batched", "worst_time_per_pose", "ms", times["batched_worst"]))
    rows.append(row("batched", f"time_for_{DATA_SET}_poses", "ms", DATA_SET * times["batched"]))
    rows.append(row("nodes", "largest_difference", "mm", times["nodes_difference_mm"]))
    for pair in RATIOS:
        above, below = pair.split("/")
        rows.append(row(pair, "time_ratio", "ratio", times[above] / times[below]))
    for way in ("nodes", "nodes_batched"):
        for name, share in shares(times, way).items():
            rows.append(row(way, f"time_per_pose[{name}]", "ms", times[f"{way}[{name}]"]))
            rows.append(row(way, f"time_share[{name}]", "ratio", share))
    return rows


def tables(rows: Sequence[Row], rounds: int | None = None) -> list[Table]:
    """Return two tables of some characters' rows: the ways to call a rig, and its nodes, slowest first."""
    value = {(row.character, row.method, row.metric): row.value for row in rows}
    characters = list(dict.fromkeys(row.character for row in rows))
    speeds, nodes = [], []
    # a line for each character: the ways to call its rig
    for name in characters:
        times = [f"{value[name, way, 'time_per_pose']:.2f}" for way in POSES]
        ratios = [f"{value[name, pair, 'time_ratio']:.1f}" for pair in RATIOS]
        whole = value[name, "batched", f"time_for_{DATA_SET}_poses"] / 60e3
        processor = f"{value[name, 'batched', 'processor_time_per_pose']:.2f}"
        speeds.append(
            (name, *times, processor, f"{value[name, 'batched', 'poses_per_second']:,.0f}", *ratios, f"{whole:.1f}")
        )
    # a line for each node, the slowest of the first character first
    names = [row.metric for row in rows if row.method == "nodes" and row.metric.startswith("time_share[")]
    share = lambda metric: value.get((characters[0], "nodes_batched", metric), 0.0)  # noqa: E731
    for metric in sorted(dict.fromkeys(names), key=share, reverse=True):
        cells = []
        for key in ((name, way) for name in characters for way in ("nodes_batched", "nodes")):
            if (*key, metric) in value:
                cells += [f"{value[*key, metric.replace('share', 'per_pose')]:.2f}"]
                cells += [f"{100 * value[*key, metric]:.0f} %"]
            else:
                cells += ["–", "–"]  # one of another rig
        nodes.append((metric.removeprefix("time_share[").removesuffix("]"), *cells))
    header = ("", "batched", "single", "nodes", "nodes batched", "batched, processor", "poses/s")
    header += (*(pair.replace("_", " ") for pair in RATIOS), f"{DATA_SET:,} poses, min")
    many = rounds or "several"
    note = f"ms a pose; batches of {BATCH} frames of the clips; medians of {many} rounds of all ways in turn."
    spans = tuple(text for name in characters for text in (f"{name}, batched", "", f"{name}, single", ""))
    return [
        Table("Rigs: time of one pose", (header,), tuple(speeds), (note,)),
        Table(
            "Rigs: what each deformer takes, node by node",
            (("", *spans), ("", *("ms", "share") * (2 * len(characters)))),
            tuple(nodes),
            ("ms a pose, and the share of the whole evaluation.",),
        ),
    ]


def speed_card(rows: Sequence[Row]) -> Table:
    """Return the table of REPRODUCING: milliseconds a pose in three ways, a character a line."""
    value = {(row.character, row.method, row.metric): row.value for row in rows}
    body = []
    for name in sorted({row.character for row in rows}, key=order_of):
        times = [f"{value[name, way, 'time_per_pose']:.1f}" for way in ("batched", "single", "nodes")]
        ratios = [f"{value[name, pair, 'time_ratio']:.1f}" for pair in RATIOS[:2]]
        body.append((name, *times, *ratios, f"{value[name, 'batched', f'time_for_{DATA_SET}_poses'] / 60e3:.1f} min"))
    header = ("", "batched", "one at a time", "node by node", "one at a time / batched", "node by node / one at a time",
              f"{DATA_SET:,} poses")  # fmt: skip
    return Table("Milliseconds a pose", (header,), tuple(body))


def speed_tables(path: Path) -> list[Table]:
    """Return the printed tables of a bench_rig.csv. Raises InputError, naming what makes it, where there is none."""
    if not path.is_file():
        raise InputError(f"{path}: there is no such results file; `make bench-rig` writes it.")
    return tables(read_results(path))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark from the command line; return the exit code."""
    parser = make_parser("bench_rig", "Time the rigs.", ", ".join(cast()))
    add_count(parser, "rounds", ROUNDS, "how often each way is timed", least=3)
    return answer(parser, _run, arguments)


def _run(options: argparse.Namespace, command_line: Sequence[str]) -> None:
    table_rows: list[Row] = []
    for character in split_names(options.characters, "for its time"):
        rig = rig_of(character)
        table_rows += rows(rig.name, bench(rig, frames_of(rig), options.rounds))
    publish("bench_rig", table_rows, tables(table_rows, options.rounds), command_line)


def frames_of(rig: Rig) -> np.ndarray:
    """Return BATCH poses (BATCH, m): frames of the clips, or uniform ones for a rig without clips."""
    generator = np.random.default_rng(0)
    if not rig.clips:
        return generator.uniform(rig.lower, rig.upper, (BATCH, len(rig.controls))).astype(np.float32)
    frames = np.concatenate([clip.values for clip in rig.clips])
    return frames[generator.choice(len(frames), BATCH)].astype(np.float32)


if __name__ == "__main__":
    sys.exit(main())
