"""Held-out error against training step, from the networks' training logs."""

from collections.abc import Mapping
from pathlib import Path

from replicate.engine.tidy_files import Column, read_csv, write_csv

LOG = (Column("step", "whole number"), *(Column(name, "number") for name in ("loss", "mm", "degrees")))
NAMES = ("character", "method")
SCHEMA = (*map(Column, NAMES), *LOG)
MISSING = "there are no such training curves; `make table2` makes them."

Curve = tuple[tuple[float, float, float, float], ...]  # (step, loss, mm, degrees) at each measurement


def read_log(path: Path) -> Curve:
    """Read a network's log.csv: step, mean loss since the row before, and mm and degrees on held-out poses.

    Raises InputError, naming file and line, for anything else.
    """
    return _curve(read_csv(path, LOG, (), MISSING))


def write_curves(path: Path, curves: Mapping[tuple[str, str], Curve]) -> None:
    """Write the curves of every (character, method) to one CSV file, sorted."""
    lines = ((*names, int(step), *map(float, rest)) for names, curve in sorted(curves.items()) for step, *rest in curve)
    write_csv(path, SCHEMA, lines)


def read_curves(path: Path) -> dict[tuple[str, str], Curve]:
    """Read what `write_curves` wrote. Raises InputError, naming file and line, for anything else."""
    frame = read_csv(path, SCHEMA, (), MISSING)
    return {names: _curve(rows) for names, rows in frame.groupby(list(NAMES), sort=False)}


def _curve(frame) -> Curve:
    columns = (column.name for column in LOG)
    return tuple(zip(*(frame[name].astype(float).tolist() for name in columns), strict=True))
