"""Results of each seed by itself, beside the table of their means: one row a number and a seed."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple
from pathlib import Path

from replicate.engine.tidy_files import Column, read_csv, write_csv
from replicate.report.results import KEY, SCHEMA, Row

SEED_SCHEMA = (Column("seed", "whole number"), *SCHEMA)
SEED_KEY = ("seed", *KEY)
Seeds = Mapping[int, Sequence[Row]]  # rows by their seed


def write_seeds(path: Path, seeds: Seeds) -> None:
    """Write the rows of every seed, sorted, to a CSV file: the columns of a table with `seed` before them."""
    lines = ((seed, row) for seed in sorted(seeds) for row in sorted(seeds[seed], key=lambda row: row.key))
    write_csv(path, SEED_SCHEMA, ((seed, *astuple(row)) for seed, row in lines), SEED_KEY)


def read_seeds(path: Path) -> dict[int, list[Row]]:
    """Read the rows of every seed. Raises InputError, naming the file and the line, for a file that holds none."""
    frame = read_csv(path, SEED_SCHEMA, SEED_KEY, missing="there is no such file of single seeds.").astype(object)
    seeds: dict[int, list[Row]] = {}
    for seed, *cells in frame.where(frame.notna(), None).itertuples(index=False, name=None):
        seeds.setdefault(int(seed), []).append(Row(*cells))
    return seeds


def where(seeds: Seeds, keep: Callable[[str], bool]) -> dict[int, list[Row]]:
    """Return the rows of those characters whose name a function says yes to."""
    return {seed: [row for row in rows if keep(row.character)] for seed, rows in seeds.items()}


def of_character(seeds: Seeds, character: str) -> dict[int, list[Row]]:
    """Return the rows of one character, of the seeds that it has."""
    return {seed: rows for seed, rows in where(seeds, character.__eq__).items() if rows}


def joined(seeds: Seeds, others: Seeds) -> dict[int, list[Row]]:
    """Return the rows of both, seed by seed."""
    return {seed: [*seeds.get(seed, ()), *others.get(seed, ())] for seed in sorted({*seeds, *others})}
