"""Held-out error against training step, from the networks' training logs."""

import csv
import io
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from replicate.engine.exceptions import InputError

LOG = ("step", "loss", "mm", "degrees")
COLUMNS = ("character", "method", *LOG)

Curve = tuple[tuple[float, float, float, float], ...]  # (step, loss, mm, degrees) at each measurement


def read_log(path: Path) -> Curve:
    """Read a network's log.csv: step, mean loss since the row before, and mm and degrees on held-out poses."""
    return tuple(tuple(numbers) for _, numbers in _read(path, LOG))


def write_curves(path: Path, curves: Mapping[tuple[str, str], Curve]) -> None:
    """Write the curves of every (character, method) to one CSV file, sorted."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for (character, method), curve in sorted(curves.items()):
        writer.writerows((character, method, int(step), *(repr(float(x)) for x in rest)) for step, *rest in curve)
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    beside.write_text(text.getvalue(), encoding="utf-8", newline="\n")
    os.replace(beside, path)


def read_curves(path: Path) -> dict[tuple[str, str], Curve]:
    """Read what `write_curves` wrote. Raises InputError, naming file and line, for anything else."""
    curves: dict[tuple[str, str], list] = {}
    for names, numbers in _read(path, COLUMNS):
        curves.setdefault(names, []).append(tuple(numbers))
    return {names: tuple(rows) for names, rows in curves.items()}


def _read(path: Path, columns: Sequence[str]):
    try:
        lines = list(csv.reader(io.StringIO(path.read_text(encoding="utf-8"))))
    except FileNotFoundError:
        raise InputError(f"{path}: there are no such training curves; `make table2` makes them.") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: found no text of comma-separated values ({error}).") from None
    if not lines or tuple(lines[0]) != tuple(columns):
        found = ",".join(lines[0]) if lines else "nothing"
        raise InputError(f"{path}, line 1: found {found!r}, where only the header {','.join(columns)!r} is allowed.")
    names = len(columns) - len(LOG)
    for number, cells in enumerate(lines[1:], start=2):
        try:
            numbers = [float(cell) for cell in cells[names:]]
        except ValueError:
            numbers = []
        if len(numbers) != len(LOG):
            raise InputError(
                f"{path}, line {number}: found {','.join(cells)!r}, "
                f"where {names} names and {len(LOG)} numbers are allowed."
            )
        yield tuple(cells[:names]), numbers
