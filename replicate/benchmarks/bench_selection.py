"""What readings of §3.3 select: how many squares, how much of the wrinkles they cover, and the refined maps' floor.

`make bench-selection` compares ways to read what the section leaves open. The error is that of offsets or of positions.
Clusters belong to one chart each, or all charts lie in one plane. And the count of clusters is where the gap to an even
error stops growing, or where the curve of 10 or 20 counts is farthest below its chord, or where nine tenths are
explained. No network is involved; floors are measured as by `make bench-floors`.
"""

import argparse
import sys
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Integer

from data_recipes.rig import Rig
from replicate.approximation import refinement
from replicate.approximation.segments import Segment
from replicate.base.exceptions import InputError
from replicate.base.progress import progress
from replicate.benchmarks.bench_floors import BATCH, floor_errors, placed_floor, some_test_offsets, vertices_in
from replicate.benchmarks.common import answer, artefacts_of, bench_characters, in_groups, make_parser, split_names
from replicate.config import Config
from replicate.methods import artefacts
from replicate.methods.plan import Plan
from replicate.report.results import Row, find
from replicate.report.tables import Table, our_value

ABOUT = "what readings of §3.3 select to be refined, what of the wrinkles that covers, and its floor"
WRITES = "results/runs/bench/bench_selection.csv"
TABLE = "bench_selection"
QUANTITIES = ("offsets", "positions")
PLANES = {"charts": "a cluster in one chart", "plane": "all charts in one plane"}
RULES = {"gap": "gap", "chord10": "chord to 10", "chord20": "chord to 20", "explained": "90 % explained"}
MOST = 20
EXPLAINED = 0.9
POSES = 3 * BATCH  # test poses of the floors
METRICS = {
    "clusters": ("count", "clusters"),
    "squares": ("count", "squares"),
    "wrinkles_covered": ("ratio", "wrinkles covered"),
    "error_covered": ("ratio", "Eq. 2 covered"),
    "normal_error_mean": ("deg", "floor, degrees"),
}


def chord(inertia: Sequence[float]) -> int:
    """Return the number of clusters, from 1, that lies farthest below the chord of an inertia curve's ends."""
    curve = np.asarray(inertia, np.float64)
    return int(np.argmax(np.linspace(curve[0], curve[-1], len(curve)) - curve)) + 1


def count(rule: str, inertia: Sequence[float], even: Sequence[float]) -> int:
    """Return the number of clusters that a rule of RULES chooses; inertias are shares of that without clusters."""
    if rule == "gap":
        return refinement.elbow(inertia, even)
    if rule == "explained":
        enough = np.flatnonzero(1 - np.asarray(inertia) >= EXPLAINED)
        return int(enough[0]) + 1 if len(enough) else len(inertia)
    return chord(inertia[: int(rule.removeprefix("chord"))])


def centroids(
    segments: Sequence[Segment], errors: Float[np.ndarray, " n"], plane: str, seed: int = 0
) -> dict[str, tuple[int, list[Float[np.ndarray, "c 2"]]]]:
    """Return the number of clusters and the centroids of every segment by rule; in one plane all segments have all."""
    charts, weights = [segment.uv for segment in segments], [errors[segment.vertices] for segment in segments]
    if plane == "plane":
        charts, weights = [np.concatenate(charts)], [np.concatenate(weights)]
    fits, dealt, inertia = refinement.deal(charts, weights, MOST, seed)
    _, _, even = refinement.deal(charts, [np.ones(len(weight)) for weight in weights], len(inertia), seed)
    selected = {}
    for rule in RULES:
        clusters = count(rule, inertia, even)
        each = zip(fits, dealt[clusters - 1], strict=True)
        centres = [fit[part - 1][1] if part else np.zeros((0, 2)) for fit, part in each]
        selected[rule] = clusters, centres * len(segments) if plane == "plane" else centres
    return selected


def wrinkled_vertices(rig: Rig) -> Integer[np.ndarray, " s"]:
    """Return the vertices that a rig's wrinkles move. Raises InputError for a rig without wrinkles."""
    states = rig.wrinkle_states(rig.default) if hasattr(rig, "wrinkle_states") else {}
    if not states:
        raise InputError(f"the rig {rig.name} has no wrinkles, and this benchmark measures how far they are refined")
    return np.unique(np.concatenate([state.vertices for state in states.values()]))


def readings(config: Config, wrinkled: Integer[np.ndarray, " s"]) -> list[Row]:
    """Return what each reading of §3.3 selects of a character, which takes no training.

    wrinkled: the vertices that the character's wrinkles move.
    """
    from replicate.approximation.deformation_map import Floor

    selection = artefacts.squares_stage(Plan(config))
    inputs = artefacts_of(TABLE, config, [selection])
    mesh, samples = artefacts.load_mesh(inputs), artefacts.load_samples(inputs)
    segments, influence = artefacts.load_coarse_segments(inputs, mesh), artefacts.load_influence(inputs)
    attachments = artefacts.load_attachments(inputs)
    poses = samples.draw(np.random.default_rng(0), min(config.refinement.poses, len(samples)))
    offsets = samples.offsets(poses)
    test = some_test_offsets(samples, POSES)
    rows = []
    with progress(len(QUANTITIES) * len(PLANES) * len(RULES), f"{selection.label}, readings") as bar:
        for quantity in QUANTITIES:
            seen = offsets if quantity == "offsets" else offsets + mesh.neutral
            errors = refinement.map_error(segments, seen, config.coarse.map_size)
            for plane in PLANES:
                for rule, (clusters, centres) in centroids(segments, errors, plane).items():
                    squares = []
                    for segment, middles in zip(segments, centres, strict=True):
                        squares += refinement.square_segments(segment, middles, influence, config.refinement.square)
                    covered = vertices_in(squares, len(mesh.neutral))
                    floor = Floor(segments, config.coarse.map_size, tuple(squares), config.refinement.map_size)
                    placed = placed_floor(mesh, attachments, floor)
                    degrees = floor_errors(mesh, placed, test, covered)[""][1]
                    share = errors[covered].sum() / errors.sum()
                    values = (clusters, len(squares), covered[wrinkled].mean(), share, degrees)
                    for (metric, (unit, _)), value in zip(METRICS.items(), values, strict=True):
                        facts = (unit, float(value), None, 1, len(test), config.profile, "bench-selection")
                        rows.append(Row(TABLE, selection.label, f"{quantity}_{plane}_{rule}", metric, *facts))
                    bar.update(1)
    return rows


def selection_table(rows: Sequence[Row], character: str) -> Table:
    """Return one character's readings, a reading a line."""
    lines = []
    for quantity in QUANTITIES:
        for plane, words in PLANES.items():
            for rule, name in RULES.items():
                reading = f"{quantity}_{plane}_{rule}"
                cells = (our_value(find(rows, TABLE, character, reading, metric)) for metric in METRICS)
                lines.append((f"{quantity}_{plane}", (f"{quantity}, {words}, {name}", *cells)))
    header = ("error of, clusters, their number", *(title for _, title in METRICS.values()))
    notes = (
        "Floor: least-squares maps of the true offsets of test poses, the refinement's on top of the coarse ones; "
        "rigid segments are placed as §3.4 does.",
    )
    return Table(f"Readings of §3.3: {character}", (header,), in_groups(lines), notes)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark from the command line; return the exit code."""
    parser = make_parser(TABLE, __doc__, profile="whose samples")
    return answer(parser, _run, arguments)


def _run(options: argparse.Namespace, command_line: Sequence[str]) -> None:
    names = split_names(options.characters, "where its skin wrinkles")
    wrinkled = {name: wrinkled_vertices(artefacts.rig_of(name)) for name in names}  # before anything is made

    def measure(config: Config) -> list[Row]:
        return readings(config, wrinkled[config.character])

    bench_characters(TABLE, measure, selection_table, options, command_line)


if __name__ == "__main__":
    sys.exit(main())
