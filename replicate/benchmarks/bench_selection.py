"""What readings of §3.3 select: how many squares, what of the wrinkles they cover, and the refined maps' floor.

`make bench-selection` holds four choices against each other that the section leaves open: the error is that of offsets
or of positions; clusters belong to one chart each, or all charts lie in one plane; their number is where the gap to an
even error stops to grow, or lies farthest below the chord of a curve of 10 or 20 numbers, or explains nine tenths.
No network is involved; floors are measured as `make bench-floors` does.
"""

import argparse
import sys
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Integer

from data_recipes.rig import Rig
from replicate.approximation import refinement
from replicate.approximation.metrics import unique_poses
from replicate.approximation.segments import Segment
from replicate.base.exceptions import InputError
from replicate.base.progress import progress
from replicate.benchmarks.bench_floors import BATCH, floor_errors, placed_floor
from replicate.benchmarks.common import answer, artefacts_of, make_parser, publish, split_names
from replicate.config import Config, resolve
from replicate.methods import artefacts
from replicate.methods.plan import Plan
from replicate.report.results import Row, find
from replicate.report.tables import Table, round_off

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
    """Return the number of clusters that a rule of RULES takes; the curves are shares of what no cluster costs."""
    if rule == "gap":
        return refinement.elbow(inertia, even)
    if rule == "explained":
        enough = np.flatnonzero(1 - np.asarray(inertia) >= EXPLAINED)
        return int(enough[0]) + 1 if len(enough) else len(inertia)
    return chord(inertia[: int(rule.removeprefix("chord"))])


def centroids(
    segments: Sequence[Segment], errors: Float[np.ndarray, " n"], plane: str, seed: int = 0
) -> dict[str, tuple[int, list[Float[np.ndarray, "c 2"]]]]:
    """Return, for each rule, the number of clusters and every segment's centroids; in one plane all have the same."""
    charts, weights = [segment.uv for segment in segments], [errors[segment.vertices] for segment in segments]
    if plane == "plane":
        charts, weights = [np.concatenate(charts)], [np.concatenate(weights)]
    fits, dealt, inertia = refinement.deal(charts, weights, MOST, seed)
    _, _, even = refinement.deal(charts, [np.ones(len(weight)) for weight in weights], len(inertia), seed)
    selected = {}
    for rule in RULES:
        k = count(rule, inertia, even)
        centres = [fit[d - 1][1] if d else np.zeros((0, 2)) for fit, d in zip(fits, dealt[k - 1], strict=True)]
        selected[rule] = k, centres * len(segments) if plane == "plane" else centres
    return selected


def wrinkled_vertices(rig: Rig) -> Integer[np.ndarray, " s"]:
    """Return the vertices that a rig's wrinkles move. Raises InputError for a rig without wrinkles."""
    states = rig.wrinkle_states(rig.default) if hasattr(rig, "wrinkle_states") else {}
    if not states:
        raise InputError(f"the rig {rig.name} has no wrinkles, and this benchmark asks what of them is refined")
    return np.unique(np.concatenate([state.vertices for state in states.values()]))


def readings(config: Config, wrinkled: Integer[np.ndarray, " s"]) -> list[Row]:
    """Make what is needed of a character, nothing trained, and return what each reading selects.

    wrinkled: the vertices that its wrinkles move.
    """
    from replicate.approximation.deformation_map import Floor

    selection = artefacts.squares_stage(Plan(config))
    inputs = artefacts_of(TABLE, config, [selection])
    mesh, samples = artefacts.load_mesh(inputs), artefacts.load_samples(inputs)
    segments, influence = artefacts.load_coarse_segments(inputs, mesh), artefacts.load_influence(inputs)
    attachments = artefacts.load_attachments(inputs)
    poses = samples.draw(np.random.default_rng(0), min(config.refinement.poses, len(samples)))
    offsets = samples.offsets(poses)
    test = unique_poses(np.asarray(samples.test_params))
    test = samples.test_offsets[test[:: max(1, len(test) // POSES)][:POSES]]
    rows = []
    with progress(len(QUANTITIES) * len(PLANES) * len(RULES), f"{selection.label}, readings") as bar:
        for quantity in QUANTITIES:
            seen = offsets if quantity == "offsets" else offsets + mesh.neutral
            errors = refinement.map_error(segments, seen, config.coarse.map_size)
            for plane in PLANES:
                for rule, (k, centres) in centroids(segments, errors, plane).items():
                    squares = []
                    for segment, own in zip(segments, centres, strict=True):
                        squares += refinement.square_segments(segment, own, influence, config.refinement.square)
                    covered = np.zeros(len(mesh.neutral), bool)
                    for square in squares:
                        covered[square.vertices] = True
                    floor = Floor(segments, config.coarse.map_size, tuple(squares), config.refinement.map_size)
                    placed = placed_floor(mesh, attachments, floor)
                    degrees = floor_errors(mesh, placed, test, covered)[""][1]
                    values = (k, len(squares), covered[wrinkled].mean(), errors[covered].sum() / errors.sum(), degrees)
                    for (metric, (unit, _)), value in zip(METRICS.items(), values, strict=True):
                        facts = (unit, float(value), None, 1, len(test), config.profile, "bench-selection")
                        rows.append(Row(TABLE, selection.label, f"{quantity}_{plane}_{rule}", metric, *facts))
                    bar.update(1)
    return rows


def selection_table(rows: Sequence[Row], character: str) -> Table:
    """Return one character's readings, a reading a line."""
    body: list[tuple[str, ...] | None] = []
    for quantity in QUANTITIES:
        for plane, words in PLANES.items():
            body += [None] if body else []
            for rule, name in RULES.items():
                cells = [f"{quantity}, {words}, {name}"]
                for metric, (unit, _) in METRICS.items():
                    row = find(rows, TABLE, character, f"{quantity}_{plane}_{rule}", metric)
                    cells.append(round_off(row.value, unit) if row else "–")
                body.append(tuple(cells))
    header = ("error of, clusters, their number", *(title for _, title in METRICS.values()))
    notes = (
        "Floor: least-squares maps of the true offsets of test poses, the refinement's on top of the coarse ones; "
        "rigid segments are placed as §3.4 does.",
    )
    return Table(f"Readings of §3.3: {character}", (header,), tuple(body), notes)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark from the command line; return the exit code."""
    parser = make_parser(TABLE, __doc__, profile="whose samples")
    return answer(parser, _run, arguments)


def _run(options: argparse.Namespace, command_line: Sequence[str]) -> None:
    names = split_names(options.characters, "where its skin wrinkles")
    wrinkled = {name: wrinkled_vertices(artefacts.rig_of(name)) for name in names}
    for name in names:
        rows = readings(resolve(name, options.profile), wrinkled[name])
        publish(TABLE, rows, [selection_table(rows, rows[0].character)], command_line)


if __name__ == "__main__":
    sys.exit(main())
