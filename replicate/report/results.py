"""Results as tidy CSV: one row a number, full precision, sorted, so that two runs can be compared with `diff`."""

import csv
import hashlib
import io
import math
import os
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass, fields, replace
from pathlib import Path

from replicate.engine.exceptions import InputError

UNITS = ("mm", "deg", "ms", "MB", "count", "ratio")


@dataclass(frozen=True, order=True)
class Row:
    """One number of one table.

    table, character, method, metric: what it is; together they are unique in a file. unit: one of `UNITS`.
    value: mean over the seeds; sd: its standard deviation over them, None for a single seed.
    seeds, poses: how many of each it stands on, None where unknown. profile: the profile that made it, or "published".
    run: which run, or for published numbers where they were printed.
    """

    table: str
    character: str
    method: str
    metric: str
    unit: str
    value: float
    sd: float | None
    seeds: int | None
    poses: int | None
    profile: str
    run: str

    @property
    def key(self) -> tuple[str, str, str, str]:
        """What the number is: (table, character, method, metric)."""
        return self.table, self.character, self.method, self.metric


COLUMNS = tuple(field.name for field in fields(Row))


def write_results(path: Path, rows: Iterable[Row]) -> None:
    """Write rows, sorted by what they are, to a CSV file; it appears whole or not at all.

    Raises InputError for a value that is no finite number, an unknown unit, or two rows about the same thing.
    """
    ordered = sorted(rows, key=lambda row: row.key)
    for number, row in enumerate(ordered, start=2):
        _check(path, number, row)
    _check_unique(path, ordered)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in ordered:
        writer.writerow(
            "" if cell is None else repr(float(cell)) if isinstance(cell, float) else cell for cell in astuple(row)
        )
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    beside.write_text(text.getvalue(), encoding="utf-8", newline="\n")
    os.replace(beside, path)


def read_results(path: Path) -> list[Row]:
    """Read a CSV file that `write_results` wrote, or one that somebody typed.

    Raises InputError, naming the file and the line, for a file that is no such table.
    """
    try:
        lines = list(csv.reader(io.StringIO(path.read_text(encoding="utf-8"))))
    except FileNotFoundError:
        raise InputError(f"{path}: there is no such results file.") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: found no text of comma-separated values ({error}).") from None
    if not lines or tuple(lines[0]) != COLUMNS:
        found = ",".join(lines[0]) if lines else "nothing"
        raise InputError(f"{path}, line 1: found {found!r}, where only the header {','.join(COLUMNS)!r} is allowed.")
    rows = [_parsed(path, number, cells) for number, cells in enumerate(lines[1:], start=2)]
    _check_unique(path, rows)
    return rows


def most_seeds(rows: Iterable[Row]) -> int:
    """Return on how many seeds the rows stand, the most of any; zero where none says so."""
    return max((row.seeds or 0 for row in rows), default=0)


def over_seeds(runs: Sequence[Sequence[Row]]) -> list[Row]:
    """Return one row for each number of several runs that differ in their seeds alone: its mean and its spread.

    A number that some runs lack (a fourth refinement segment, say) stands on the others. `poses` becomes the smallest
    of the runs, since the test poses are drawn anew with every seed; `run` names all of them.
    """
    if len(runs) == 1:
        return list(runs[0])
    name = hashlib.sha256("\n".join(sorted({row.run for rows in runs for row in rows})).encode()).hexdigest()[:12]
    same: dict[tuple, list[Row]] = {}
    for rows in runs:
        for row in rows:
            same.setdefault(row.key, []).append(row)
    merged = []
    for found in same.values():
        values = [row.value for row in found]
        poses = [row.poses for row in found if row.poses is not None]
        facts = {"value": statistics.fmean(values), "sd": None, "seeds": len(found), "run": name}
        if len(values) > 1:
            facts["sd"] = statistics.stdev(values)
        merged.append(replace(found[0], **facts, poses=min(poses) if poses else None))
    return merged


def find(rows: Iterable[Row], table: str, character: str, method: str, metric: str) -> Row | None:
    """Return the row about one thing, or None."""
    return next((row for row in rows if row.key == (table, character, method, metric)), None)


def _parsed(path: Path, number: int, cells: list[str]) -> Row:
    if len(cells) != len(COLUMNS):
        raise InputError(f"{path}, line {number}: found {len(cells)} cells, where {len(COLUMNS)} are allowed.")
    given = dict(zip(COLUMNS, cells, strict=True))
    numbers = {}
    for name, kind in (("value", float), ("sd", float), ("seeds", int), ("poses", int)):
        try:
            numbers[name] = kind(given[name]) if given[name] or name == "value" else None
        except ValueError:
            wanted = "a number" if kind is float else "a whole number"
            raise InputError(
                f"{path}, line {number}: {name} is {given[name]!r}, where only {wanted} is allowed."
            ) from None
    row = Row(**(given | numbers))
    _check(path, number, row)
    return row


def _check(path: Path, number: int, row: Row) -> None:
    if not math.isfinite(row.value):
        raise InputError(
            f"{path}, line {number}: value is {row.value} for {row.key}, where only finite numbers are allowed."
        )
    if row.unit not in UNITS:
        raise InputError(f"{path}, line {number}: unit is {row.unit!r}, where only {', '.join(UNITS)} are allowed.")


def _check_unique(path: Path, rows: list[Row]) -> None:
    seen = set()
    for number, row in enumerate(rows, start=2):
        if row.key in seen:
            raise InputError(f"{path}, line {number}: found a second row for {row.key}, where one is allowed.")
        seen.add(row.key)
