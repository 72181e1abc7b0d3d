"""The best that maps can do: floors at several resolutions, over the head and where it is refined.

`make bench-floors` fits maps to the true offsets of test poses by least squares (`deformation_map.Floor`), no network
involved: coarse maps of 16 to 128 pixels a side, and refinement maps of the same sizes on top of the profile's coarse
ones; rigid segments are placed as §3.4 does. The refined regions are the triangles whose corners all lie in refinement
segments.
"""

import sys
from collections.abc import Callable, Iterable, Sequence
from functools import partial

import numpy as np
from jaxtyping import Bool, Float

from replicate.approximation.metrics import normal_error, unique_poses, vertex_error
from replicate.approximation.rigid import Attachments, attach
from replicate.approximation.samples import SampleSet
from replicate.approximation.segments import Segment
from replicate.base.progress import progress
from replicate.benchmarks.common import answer, artefacts_of, bench_characters, in_groups, make_parser
from replicate.config import Config
from replicate.geometry.mesh import Mesh
from replicate.methods import artefacts
from replicate.methods.plan import Plan
from replicate.report.results import Row, find
from replicate.report.tables import Table, our_value, round_off

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
    """Return the mean vertex error (mm) and normal error (degrees) of a floor by region, over some true offsets (mm).

    inside: the vertices of the refined regions.
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
    """Return a floor, true offsets (b, n, 3) mm → what maps hold of them, that places rigid segments too (§3.4).

    floor: the one of the maps, which leaves rigid segments at rest.
    """

    def placed(offsets: np.ndarray) -> np.ndarray:
        return attach(mesh, attachments, mesh.neutral + floor(offsets)) - mesh.neutral

    return placed


def some_test_offsets(samples: SampleSet, count: int) -> Float[np.ndarray, "p n 3"]:
    """Return the true offsets (mm) of about `count` test poses, evenly spread."""
    poses = unique_poses(np.asarray(samples.test_params))
    return samples.test_offsets[poses[:: max(1, len(poses) // count)][:count]]


def vertices_in(segments: Iterable[Segment], count: int) -> Bool[np.ndarray, " n"]:
    """Return which of a mesh's `count` vertices lie in some segment."""
    inside = np.zeros(count, bool)
    for segment in segments:
        inside[segment.vertices] = True
    return inside


def floors(config: Config) -> list[Row]:
    """Return a character's floors at all sizes, which takes no training."""
    from replicate.approximation.deformation_map import Floor

    selection = artefacts.squares_stage(Plan(config))
    inputs = artefacts_of(TABLE, config, [selection])
    mesh, samples = artefacts.load_mesh(inputs), artefacts.load_samples(inputs)
    segments, squares = artefacts.load_coarse_segments(inputs, mesh), artefacts.load_squares(inputs)
    attachments, inside = artefacts.load_attachments(inputs), vertices_in(squares, len(mesh.neutral))
    offsets, rows = some_test_offsets(samples, POSES), []

    def add(level: str, metric: str, unit: str, value: float) -> None:
        facts = (unit, value, None, 1, len(offsets), config.profile, "bench-floors")
        rows.append(Row(TABLE, selection.label, level, metric, *facts))

    with progress(len(LEVELS) * len(SIZES), f"{selection.label}, floors") as bar:
        for level in LEVELS:
            for size in SIZES:
                coarse = size if level == "coarse" else config.coarse.map_size
                floor = Floor(segments, coarse, squares if level == "refinement" else (), size)
                maps = segments if level == "coarse" else squares
                texels = size**2 * len(maps) / max(sum(len(segment.vertices) for segment in maps), 1)
                add(level, f"texels_per_vertex[{size}]", "ratio", texels)
                placed = placed_floor(mesh, attachments, floor)
                for region, errors in floor_errors(mesh, placed, offsets, inside).items():
                    suffix = f"[{size}, {region}]" if region else f"[{size}]"
                    for kind, unit, value in zip(("vertex", "normal"), ("mm", "deg"), errors, strict=True):
                        add(level, f"{kind}_error_mean{suffix}", unit, value)
                bar.update(1)
    return rows


def floors_table(rows: Sequence[Row], character: str) -> Table:
    """Return one character's floors, a resolution a line, and each over that of half the resolution."""
    lines = []
    for level, words in LEVELS.items():
        before: dict[str, float] = {}
        for size in SIZES:
            texels = find(rows, TABLE, character, level, f"texels_per_vertex[{size}]")
            cells = [f"{words}, {size}×{size}", our_value(texels)]
            for region in REGIONS:
                suffix = f"[{size}, {region}]" if region else f"[{size}]"
                for kind in ("vertex", "normal"):
                    row = find(rows, TABLE, character, level, f"{kind}_error_mean{suffix}")
                    key = f"{region} {kind}"
                    share = row.value / before[key] if row and before.get(key) else None
                    cells += [our_value(row), round_off(share, "ratio")]
                    before[key] = row.value if row else 0.0
            lines.append((level, cells))
    header = [
        "",
        "texels per vertex",
        *(f"{title}{region}" for region in ("", ", refined") for title in ("mm", "× half", "degrees", "× half")),
    ]
    notes = (
        "Least-squares maps of the true offsets of test poses; rigid segments are placed as §3.4 does. × half: "
        "over the floor at half the resolution.",
    )
    return Table(f"Projection floors: {character}", (tuple(header),), in_groups(lines), notes)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark from the command line; return the exit code."""
    parser = make_parser(TABLE, __doc__, profile="whose samples and refinement segments")
    return answer(parser, partial(bench_characters, TABLE, floors, floors_table), arguments)


if __name__ == "__main__":
    sys.exit(main())
