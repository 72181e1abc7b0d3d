"""Where a character's control points are dragged: as its file of drags says, or as a script draws them (§5.3.1)."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from data_recipes.recipe_paths import drags_file
from data_recipes.rig import Rig
from replicate.base.exceptions import InputError
from replicate.base.tables import Column, read_csv, write_csv
from replicate.engine.stage import stream_rng
from replicate.inverse.control_points import ControlPoints, targets_of_drags

# Configurations of control points: which points a user drags, and how far, as a CSV beside the recipes (§5.3.1).

COUNT, MOST_POINTS, SHORTEST_MM, LONGEST_MM = 25, 5, 3.0, 25.0
SCHEMA = (
    Column("configuration", "whole number"),
    Column("point"),
    Column("x_mm", "finite number"),
    Column("y_mm", "finite number"),
)
KEY = ("configuration", "point")


@dataclass(frozen=True)
class Drag:
    """One control point, by name, and how far it is dragged in the image plane, mm."""

    point: str
    x_mm: float
    y_mm: float


Configuration = tuple[Drag, ...]


def scripted_drags(names: Sequence[str], generator: np.random.Generator, count: int = COUNT) -> list[Configuration]:
    """Draw configurations: 1, 2, … 5 points in turn, each a random one, dragged in a random direction.

    Lengths are uniform between SHORTEST_MM and LONGEST_MM, rounded to a hundredth of a millimetre.
    """
    configurations = []
    for k in range(count):
        chosen = generator.permutation(len(names))[: min(k % MOST_POINTS + 1, len(names))]
        length = generator.uniform(SHORTEST_MM, LONGEST_MM, len(chosen))
        angle = generator.uniform(0, 2 * np.pi, len(chosen))
        moves = np.stack([length * np.cos(angle), length * np.sin(angle)], axis=1).round(2)
        points = [(names[point], *move) for point, move in zip(chosen, moves.tolist(), strict=True)]
        configurations.append(tuple(Drag(*point) for point in sorted(points)))
    return configurations


def write_drags(file: Path, configurations: Sequence[Configuration]) -> None:
    """Write configurations as CSV, a drag a line; they are numbered from 1."""
    lines = [(k, d.point, d.x_mm, d.y_mm) for k, drags in enumerate(configurations, 1) for d in drags]
    write_csv(file, SCHEMA, lines, KEY)


def read_drags(file: Path, names: Sequence[str]) -> list[Configuration]:
    """Read what `write_drags` wrote, or what somebody typed. names: of the control points.

    Raises InputError, naming the file, for a bad table, for a point that the character doesn't have, and for a file
    without drags.
    """
    frame = read_csv(file, SCHEMA, KEY, missing="there is no such file of drags.")
    if frame.empty:
        raise InputError(f"{file}: expected at least one drag, got none.")
    unknown = sorted(set(frame["point"]) - set(names))
    if unknown:
        raise InputError(f"{file}: there is no control point {unknown[0]!r}; there are {', '.join(names)}.")
    groups = frame.groupby("configuration", sort=True)
    return [tuple(Drag(*cells[1:]) for cells in group.itertuples(index=False)) for _, group in groups]


def targets_of(neutral: np.ndarray, names: Sequence[str], configurations: Sequence[Configuration]) -> np.ndarray:
    """Return where the control points are wanted, (k, c, 3) float32 mm; those that nobody drags stay.

    neutral: (c, 3), the control points of the neutral pose.
    """
    moves = [[(drag.point, (drag.x_mm, drag.y_mm)) for drag in drags] for drags in configurations]
    return np.stack([targets_of_drags(neutral, names, of_configuration) for of_configuration in moves])


def files_of(character: str) -> tuple[Path, ...]:
    """Return a tuple with the file of a character's drags, empty where there is none."""
    file = drags_file(character)
    return (file,) if file.is_file() else ()


def configurations(
    rig: Rig, points: ControlPoints, files: Sequence[Path] = (), stream: str = "table4", count: int = COUNT
) -> Float32[np.ndarray, "k c 3"]:
    """Return where the control points are wanted in each configuration, (k, c, 3) mm.

    rig: for its neutral pose
    points: the rig's control points
    files: from `files_of`; without a file a script draws the configurations
    stream: the name of the script's random stream
    count: how many configurations the script draws

    Raises InputError as `read_drags` does.
    """
    if files:
        drags = read_drags(files[0], points.names)
    else:
        drags = scripted_drags(points.names, stream_rng(0, stream, "drags"), count)
    return targets_of(rig.mesh.neutral[points.vertices], points.names, drags)
