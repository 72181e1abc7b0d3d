"""Results as tidy CSV: one row for each number, in full precision and sorted, so that `diff` can compare two runs."""

import hashlib
import re
import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from data_recipes.recipe_paths import OUTSIDE, STANDS_FOR, recipe_file
from replicate.approximation.metrics import Errors, summary
from replicate.base.exceptions import InputError
from replicate.base.paths import PAPER, committed_folders, display_path, run_folder
from replicate.base.tables import Column, read_csv, write_csv
from replicate.config import PROFILES

if TYPE_CHECKING:
    import pandas


UNITS = ("mm", "deg", "ms", "s", "J", "MB", "count", "ratio")
KEY = ("table", "character", "method", "metric")  # the columns that identify a number
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

    table, character, method, metric: what it is; together they are unique in a file
    unit: one of `UNITS`
    value: its mean over the seeds
    sd: its standard deviation over the seeds, None for a single seed
    seeds: the number of seeds, None where unknown
    poses: the number of poses, None where unknown
    profile: the profile that made it, or "published"
    run: the run that made it, or for published numbers where they were printed
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
        """What identifies the number: (table, character, method, metric)."""
        return self.table, self.character, self.method, self.metric


def write_results(path: Path, rows: Iterable[Row]) -> None:
    """Write rows, sorted by their keys, to a CSV file; it appears whole or not at all.

    Raises InputError for a value that isn't a finite number, an unknown unit, or two rows with the same key.
    """
    write_csv(path, SCHEMA, map(astuple, sorted(rows, key=lambda row: row.key)), KEY)


def read_table(path: Path) -> "pandas.DataFrame":
    """Read a CSV file with the columns of `SCHEMA`, whether `write_results` or a person wrote it.

    Raises InputError, naming the file and the line, for any other file.
    """
    return read_csv(path, SCHEMA, KEY, missing="there is no such results file.")


def read_results(path: Path) -> list[Row]:
    """Read a table as `Row`s. Raises InputError as `read_table` does."""
    frame = read_table(path).astype(object)
    return [Row(*cells) for cells in frame.where(frame.notna(), None).itertuples(index=False, name=None)]


def most_seeds(rows: Iterable[Row]) -> int:
    """Return the largest number of seeds of any row, zero if none has one."""
    return max((row.seeds or 0 for row in rows), default=0)


def seeds_in_words(counts: Iterable[int]) -> str:
    """Return counts of seeds in words: "one seed", "3 seeds" or, where they differ, "2 to 3 seeds"; "" for none."""
    each = sorted({count for count in counts if count})
    if each in ([], [1]):
        return "one seed" if each else ""
    return f"{each[0]} to {each[-1]} seeds" if len(each) > 1 else f"{each[0]} seeds"


def seeds_note(rows: Sequence[Row]) -> str:
    """Return the counts of seeds of the characters in a table, and what its ± means, as a note."""
    characters = {row.character for row in rows}
    words = seeds_in_words(most_seeds(row for row in rows if row.character == name) for name in characters)
    return f"{words}, ± their standard deviation" if most_seeds(rows) > 1 else words


def over_seeds(runs: Sequence[Sequence[Row]]) -> list[Row]:
    """Average the numbers of several runs that differ in their seeds alone: return their means and spreads.

    A number that some runs lack (a fourth refinement segment, say) is averaged over the others. `poses` becomes the
    smallest of the runs, since every seed draws its own test poses; `run` names all of them.
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
    """Return the name of the rows' run or, if there are several, a name for all of them together."""
    names = sorted({row.run for row in rows})
    return names[0] if len(names) == 1 else hashlib.sha256("\n".join(names).encode()).hexdigest()[:12]


def find(rows: Iterable[Row], table: str, character: str, method: str, metric: str) -> Row | None:
    """Return the row with a key, or None."""
    for row in rows:  # compare first what differs most: this loop runs often
        if row.metric == metric and row.method == method and row.character == character and row.table == table:
            return row
    return None


def run_name(inputs: Mapping[str, Path]) -> str:
    """Return the name of a run for the column `run`: a hash of the keys of the artefacts behind its numbers."""
    return hashlib.sha256("\n".join(sorted(path.name for path in inputs.values())).encode()).hexdigest()[:12]


# A method's errors as rows of Table 2: over the whole mesh, and segment by segment.


def error_rows(character: str, errors: Mapping[str, Errors], profile: str, run: str, seeds: int = 1) -> list[Row]:
    """Return the rows of methods' errors: of "table2", and of "table2_segments" with the metrics metric[segment].

    errors: by method. profile, run, seeds: for the rows' columns.
    """
    rows = []
    for label, error in errors.items():
        values = [("table2", "normal_faces_left_out", "count", summary(error.normal).left_out)]
        for group in (None, *range(len(error.group_names))):
            table = "table2" if group is None else "table2_segments"
            suffix = "" if group is None else f"[{error.group_names[group]}]"
            for kind, unit, tally in (("vertex", "mm", error.vertex), ("normal", "deg", error.normal)):
                statistics = summary(tally, group)
                for name in ("mean", "p95", "max") if statistics.count else ():
                    values.append((table, f"{kind}_error_{name}{suffix}", unit, getattr(statistics, name)))
        for table, metric, unit, value in values:
            poses = len(error.pose_mm)
            rows.append(Row(table, character, label, metric, unit, float(value), None, seeds, poses, profile, run))
    return rows


# Results of each single seed, beside the table of their means: one row for each number and seed.

SEED_SCHEMA = (Column("seed", "whole number"), *SCHEMA)
SEED_KEY = ("seed", *KEY)
Seeds = Mapping[int, Sequence[Row]]  # rows by their seed


def write_seeds(path: Path, seeds: Seeds) -> None:
    """Write the rows of every seed, sorted, to a CSV file: the column `seed`, then those of a table."""
    lines = ((seed, row) for seed in sorted(seeds) for row in sorted(seeds[seed], key=lambda row: row.key))
    write_csv(path, SEED_SCHEMA, ((seed, *astuple(row)) for seed, row in lines), SEED_KEY)


def read_seeds(path: Path) -> dict[int, list[Row]]:
    """Read the rows of every seed. Raises InputError, naming the file and the line, for any other file."""
    frame = read_csv(path, SEED_SCHEMA, SEED_KEY, missing="there is no such file of single seeds.").astype(object)
    seeds: dict[int, list[Row]] = {}
    for seed, *cells in frame.where(frame.notna(), None).itertuples(index=False, name=None):
        seeds.setdefault(int(seed), []).append(Row(*cells))
    return seeds


def where(seeds: Seeds, keep: Callable[[str], bool]) -> dict[int, list[Row]]:
    """Return the rows of the characters for whose names `keep` returns True."""
    return {seed: [row for row in rows if keep(row.character)] for seed, rows in seeds.items()}


def of_character(seeds: Seeds, character: str) -> dict[int, list[Row]]:
    """Return the rows of one character, by the seeds that it has."""
    return {seed: rows for seed, rows in where(seeds, character.__eq__).items() if rows}


def joined(seeds: Seeds, others: Seeds) -> dict[int, list[Row]]:
    """Return the rows of both, seed by seed."""
    return {seed: [*seeds.get(seed, ()), *others.get(seed, ())] for seed in sorted({*seeds, *others})}


# The order in which tables list characters: those that stand for the paper's four first.


def cast() -> tuple[str, ...]:
    """Return the characters with a recipe that stand for the paper's four, in the paper's order."""
    return tuple(name for name in STANDS_FOR if recipe_file(name).is_file())


def order_of(character: str) -> tuple[bool, int, str]:
    """Return a sort key of characters: first stand-ins for the paper's four in its order, then others by name.

    Variants, such as teen@one_face, come last, in the order of their characters.
    """
    names, (base, at, _) = list(STANDS_FOR), character.partition("@")
    return bool(at), (names.index(base) if base in names else len(names)), character


def has_committed_meshes(character: str) -> bool:
    """Return whether meshes of a character's test poses are committed, beside numbers and pictures.

    They are not for faces from outside this project, nor for variants, such as teen@one_face, to save space.
    """
    return character not in OUTSIDE and "@" not in character


def characters_of(rows: Iterable[Row]) -> list[str]:
    """Return the characters of some rows in the order of tables (`order_of`)."""
    return sorted({row.character for row in rows}, key=order_of)


# Held-out errors over training steps, from the networks' training logs.

LOG_MEASURES = (Column("step", "whole number"), *(Column(name, "number") for name in ("loss", "mm", "degrees")))
CURVE_NAMES = ("character", "method")
CURVE_COLUMNS = (*map(Column, CURVE_NAMES), *LOG_MEASURES)
MISSING = "there are no such training curves; `make table2` makes them."

Curve = tuple[tuple[float, float, float, float], ...]  # (step, loss, mm, degrees) at each measurement


def read_log(path: Path) -> Curve:
    """Read a network's log.csv: step, mean loss since the row before, and mm and degrees on held-out poses.

    Raises InputError, naming file and line, for any other file.
    """
    return _curve(read_csv(path, LOG_MEASURES, (), MISSING))


def write_curves(path: Path, curves: Mapping[tuple[str, str], Curve]) -> None:
    """Write the curves of every (character, method) to one CSV file, sorted."""
    lines = ((*names, int(step), *map(float, rest)) for names, curve in sorted(curves.items()) for step, *rest in curve)
    write_csv(path, CURVE_COLUMNS, lines)


def read_curves(path: Path) -> dict[tuple[str, str], Curve]:
    """Read a file of `write_curves`. Raises InputError, naming file and line, for any other file."""
    frame = read_csv(path, CURVE_COLUMNS, (), MISSING)
    return {names: _curve(rows) for names, rows in frame.groupby(list(CURVE_NAMES), sort=False)}


def _curve(frame) -> Curve:
    columns = (column.name for column in LOG_MEASURES)
    return tuple(zip(*(frame[name].astype(float).tolist() for name in columns), strict=True))


# All results of a run as one tidy DataFrame.

TABLE_FILE = re.compile(r"(table\d+|figure\d+|rig_report|bench_\w+)\.csv")  # other CSV files belong to a figure


def read_run(run: str) -> "pandas.DataFrame":
    """Return every table of a run, with the columns and dtypes of `SCHEMA`; empty cells are missing values.

    run: as in `replicate.results`. Raises InputError for an unknown run, for one without results, for a file that is no
    table, and for a number that two files have.
    """
    import pandas

    folder = _folder(run)
    files = sorted(file for file in folder.glob("*.csv") if TABLE_FILE.fullmatch(file.name))
    if not files:
        raise InputError(f"{display_path(folder)}: there are no results yet; {_how_to_make(run)}.")
    tables = pandas.concat({file: read_table(file) for file in files}, names=["file", "line"])
    repetitions = tables.index[tables.duplicated(list(KEY))]
    if len(repetitions):
        file, line = repetitions[0]
        key = tuple(tables.loc[(file, line), list(KEY)])
        raise InputError(f"{file}, line {line + 2}: found a second row for {key}, which another file has already.")
    return tables.reset_index(drop=True)


def _folder(run: str) -> Path:
    folders = committed_folders() | {"published": PAPER}
    if run in folders:
        return folders[run]
    if run not in (*PROFILES, "bench"):
        choices = ", ".join((*folders, *PROFILES, "bench"))
        raise InputError(f"there are no results named {run!r}; there can be {choices}.")
    return run_folder(run)


def _how_to_make(run: str) -> str:
    if run == "bench":
        return "`make bench-rig` writes the first, and `make help` lists the other benchmarks"
    advice = f"`make table1 PROFILE={run}` or `make table2 PROFILE={run}` writes them"
    return advice + (', and "published" are the paper\'s own' if run == "paper" else "")
