"""What maps of a resolution can hold at best: floors at several resolutions, over the head and where it is refined.

`make bench-floors` fits maps to the true offsets of test poses by least squares (`deformation_map.Floor`), no network
involved: coarse maps of 16 to 128 pixels a side, and refinement maps of the same sizes on top of the profile's coarse
ones; rigid segments are placed as §3.4 does. The refined regions are the triangles whose corners all lie in refinement
segments.
"""

import argparse
import sys
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Bool, Float

from replicate.approximation.metrics import normal_error, unique_poses, vertex_error
from replicate.approximation.rigid import Attachments, attach
from replicate.base.progress import progress
from replicate.benchmarks.common import answer, artefacts_of, make_parser, publish, split_names
from replicate.config import Config, resolve
from replicate.geometry.mesh import Mesh
from replicate.methods import artefacts
from replicate.methods.plan import Plan
from replicate.report.results import Row, find
from replicate.report.tables import Table, round_off

ABOUT = "what maps of several resolutions can hold at best, where skin wrinkles and elsewhere"
WRITES = "results/runs/bench/bench_floors.csv"
TABLE = "bench_floors"
SIZES = (16, 32, 64, 128)
POSES = 100
BATCH = 20
LEVELS = {"coarse": "coarse maps", "refinement": "refinement maps on coarse ones"}
REGIONS = {"": "all", "refined": "refined regions"}


def floor_errors(
    mesh: Mesh,
    floor: Callable[[np.ndarray], np.ndarray],
    offsets: Float[np.ndarray, "b n 3"],
    inside: Bool[np.ndarray, " n"],
) -> dict[str, tuple[float, float]]:
    """Return what a floor misses of true offsets (mm): region → mean vertex error (mm) and mean normal error (degrees).

    inside: which vertices the refined regions consist of.
    """
    vertices, faces = {"": slice(None), "refined": inside}, {"": slice(None), "refined": inside[mesh.faces].all(1)}
    sums = {region: np.zeros((2, 2)) for region in REGIONS}
    for start in range(0, len(offsets), BATCH):
        truth = mesh.neutral + np.asarray(offsets[start : start + BATCH], np.float32)
        projection = mesh.neutral + floor(truth - mesh.neutral)
        millimetres, degrees = vertex_error(projection, truth), normal_error(projection, truth, mesh.faces)
        for region, total in sums.items():
            for k, values in enumerate((millimetres[:, vertices[region]], degrees[:, faces[region]])):
                valid = np.isfinite(values)
                total[k] += values[valid].sum(dtype=np.float64), valid.sum()
    return {region: tuple(float(total / max(count, 1)) for total, count in both) for region, both in sums.items()}


def placed_floor(
    mesh: Mesh, attachments: Attachments, floor: Callable[[np.ndarray], np.ndarray]
) -> Callable[[np.ndarray], np.ndarray]:
    """Return a floor that places rigid segments by their attachments (§3.4), where the maps' own leaves them at rest.

    floor: as the one returned: true offsets (b, n, 3), mm → what is held of them, (b, n, 3), mm.
    """

    def placed(offsets: np.ndarray) -> np.ndarray:
        return attach(mesh, attachments, mesh.neutral + floor(offsets)) - mesh.neutral

    return placed


def floors(config: Config) -> list[Row]:
    """Make what is needed of a character, nothing trained, and return its floors at all sizes."""
    from replicate.approximation.deformation_map import Floor

    selection = artefacts.squares_stage(Plan(config))
    inputs = artefacts_of(TABLE, config, [selection])
    mesh, samples = artefacts.load_mesh(inputs), artefacts.load_samples(inputs)
    segments, squares = artefacts.load_coarse_segments(inputs, mesh), artefacts.load_squares(inputs)
    attachments, inside = artefacts.load_attachments(inputs), np.zeros(len(mesh.neutral), bool)
    for square in squares:
        inside[square.vertices] = True
    poses = unique_poses(np.asarray(samples.test_params))
    poses = poses[:: max(1, len(poses) // POSES)][:POSES]
    offsets, rows = samples.test_offsets[poses], []
    with progress(len(LEVELS) * len(SIZES), f"{selection.label}, floors") as bar:
        for level in LEVELS:
            for size in SIZES:
                coarse = size if level == "coarse" else config.coarse.map_size
                floor = Floor(segments, coarse, squares if level == "refinement" else (), size)
                maps = segments if level == "coarse" else squares
                texels = size**2 * len(maps) / max(sum(len(one.vertices) for one in maps), 1)
                facts = ("ratio", texels, None, 1, len(poses), config.profile, "bench-floors")
                rows.append(Row(TABLE, selection.label, level, f"texels_per_vertex[{size}]", *facts))
                placed = placed_floor(mesh, attachments, floor)
                for region, errors in floor_errors(mesh, placed, offsets, inside).items():
                    suffix = f"[{size}, {region}]" if region else f"[{size}]"
                    for kind, unit, value in zip(("vertex", "normal"), ("mm", "deg"), errors, strict=True):
                        facts = (unit, value, None, 1, len(poses), config.profile, "bench-floors")
                        rows.append(Row(TABLE, selection.label, level, f"{kind}_error_mean{suffix}", *facts))
                bar.update(1)
    return rows


def floors_table(rows: Sequence[Row], character: str) -> Table:
    """Return one character's floors, a resolution a line, and each over that of half the resolution."""
    body: list[tuple[str, ...] | None] = []
    for level, words in LEVELS.items():
        body += [None] if body else []
        before: dict[str, float] = {}
        for size in SIZES:
            texels = find(rows, TABLE, character, level, f"texels_per_vertex[{size}]")
            cells = [f"{words}, {size}×{size}", round_off(texels.value, "ratio") if texels else "–"]
            for region in REGIONS:
                suffix = f"[{size}, {region}]" if region else f"[{size}]"
                for kind, unit in (("vertex", "mm"), ("normal", "deg")):
                    row = find(rows, TABLE, character, level, f"{kind}_error_mean{suffix}")
                    key = f"{region} {kind}"
                    share = row.value / before[key] if row and before.get(key) else None
                    cells += [
                        round_off(row.value, unit) if row else "–",
                        "–" if share is None else round_off(share, "ratio"),
                    ]
                    before[key] = row.value if row else 0.0
            body.append(tuple(cells))
    header = [
        "",
        "texels per vertex",
        *(f"{what}{region}" for region in ("", ", refined") for what in ("mm", "× half", "degrees", "× half")),
    ]
    notes = (
        "Least-squares maps of the true offsets of test poses; rigid segments are placed as §3.4 does. × half: "
        "over the floor at half the resolution.",
    )
    return Table(f"Projection floors: {character}", (tuple(header),), tuple(body), notes)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark from the command line; return the exit code."""
    parser = make_parser(TABLE, __doc__, profile="whose samples and refinement segments")
    return answer(parser, _run, arguments)


def _run(options: argparse.Namespace, command_line: Sequence[str]) -> None:
    for character in split_names(options.characters):
        rows = floors(resolve(character, options.profile))
        publish(TABLE, rows, [floors_table(rows, rows[0].character)], command_line)


if __name__ == "__main__":
    sys.exit(main())
