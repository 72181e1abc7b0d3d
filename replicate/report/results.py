"""Results as tidy CSV: one row a number, full precision, sorted, so that two runs can be compared with `diff`."""

import hashlib
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from replicate.engine.tidy_files import Column, read_csv, write_csv

if TYPE_CHECKING:
    import pandas

UNITS = ("mm", "deg", "ms", "s", "J", "MB", "count", "ratio")
KEY = ("table", "character", "method", "metric")  # what a number is
SCHEMA = (
    *map(Column, KEY),
    Column("unit", choices=UNITS),
    Column("value", "finite number"),
    Column("sd", "finite number", optional=True),
    Column("seeds", "whole number", optional=True),
    Column("poses", "whole number", optional=True),
    Column("profile"),
    Column("run"),
)
COLUMNS = tuple(column.name for column in SCHEMA)


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


def write_results(path: Path, rows: Iterable[Row]) -> None:
    """Write rows, sorted by what they are, to a CSV file; it appears whole or not at all.

    Raises InputError for a value that is no finite number, an unknown unit, or two rows about the same thing.
    """
    write_csv(path, SCHEMA, map(astuple, sorted(rows, key=lambda row: row.key)), KEY)


def read_table(path: Path) -> "pandas.DataFrame":
    """Read a CSV file that `write_results` wrote, or one that somebody typed: a number a row, columns as in `SCHEMA`.

    Raises InputError, naming the file and the line, for a file that is no such table.
    """
    return read_csv(path, SCHEMA, KEY, missing="there is no such results file.")


def read_results(path: Path) -> list[Row]:
    """Read a table as `Row`s, for single look-ups. Raises InputError as `read_table` does."""
    frame = read_table(path).astype(object)
    return [Row(*cells) for cells in frame.where(frame.notna(), None).itertuples(index=False, name=None)]


def most_seeds(rows: Iterable[Row]) -> int:
    """Return on how many seeds the rows stand, the most of any; zero where none says so."""
    return max((row.seeds or 0 for row in rows), default=0)


def seeds_in_words(counts: Iterable[int]) -> str:
    """Return some numbers of seeds as "one seed", "3 seeds" or, where they differ, "2 to 3 seeds"; "" for none."""
    each = sorted({count for count in counts if count})
    if each in ([], [1]):
        return "one seed" if each else ""
    return f"{each[0]} to {each[-1]} seeds" if len(each) > 1 else f"{each[0]} seeds"


def seeds_note(rows: Sequence[Row]) -> str:
    """Return on how many seeds a table of some rows stands, character by character, and what its ± means."""
    characters = {row.character for row in rows}
    words = seeds_in_words(most_seeds(row for row in rows if row.character == name) for name in characters)
    return f"{words}, ± their standard deviation" if most_seeds(rows) > 1 else words


def over_seeds(runs: Sequence[Sequence[Row]]) -> list[Row]:
    """Return one row for each number of several runs that differ in their seeds alone: its mean and its spread.

    A number that some runs lack (a fourth refinement segment, say) stands on the others. `poses` becomes the smallest
    of the runs, since the test poses are drawn anew with every seed; `run` names all of them.
    """
    if len(runs) == 1:
        return list(runs[0])
    name = joint_run(row for rows in runs for row in rows)
    same: dict[tuple, list[Row]] = {}
    for rows in runs:
        for row in rows:
            same.setdefault(row.key, []).append(row)
    merged = []
    for group in same.values():
        values = [row.value for row in group]
        poses = [row.poses for row in group if row.poses is not None]
        facts = {"value": statistics.fmean(values), "sd": None, "seeds": len(group), "run": name}
        if len(values) > 1:
            facts["sd"] = statistics.stdev(values)
        merged.append(replace(group[0], **facts, poses=min(poses) if poses else None))
    return merged


def joint_run(rows: Iterable[Row]) -> str:
    """Return the name of the run that all rows are of, or one that stands for all of their runs together."""
    names = sorted({row.run for row in rows})
    return names[0] if len(names) == 1 else hashlib.sha256("\n".join(names).encode()).hexdigest()[:12]


def find(rows: Iterable[Row], table: str, character: str, method: str, metric: str) -> Row | None:
    """Return the row about one thing, or None."""
    for row in rows:  # the parts that differ most come first: tables are read row by row
        if row.metric == metric and row.method == method and row.character == character and row.table == table:
            return row
    return None
