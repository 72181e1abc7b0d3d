"""All results of a run as one tidy DataFrame."""

import re
from pathlib import Path
from typing import TYPE_CHECKING

from replicate.engine.exceptions import InputError
from replicate.engine.paths import PAPER, committed_folders, display_path, run_folder
from replicate.profiles import PROFILES
from replicate.report.results import KEY, read_table

if TYPE_CHECKING:
    import pandas

TABLE_FILE = re.compile(
    r"(table\d+|figure\d+|rig_report|bench_\w+)\.csv"
)  # other CSV files hold what is behind a figure


def read_run(run: str) -> "pandas.DataFrame":
    """Return every table of a run, with the columns and dtypes of `results.SCHEMA`; empty cells are missing values.

    run: as in `replicate.results`. Raises InputError for a run of another name, for one without results, for a file
    that is no table, and for a number that two files have.
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
        raise InputError(f"there are no results named {run!r}: allowed are {choices}.")
    return run_folder(run)


def _how_to_make(run: str) -> str:
    if run == "bench":
        return "`make bench-rig` writes the first, and `make help` lists the other benchmarks"
    advice = f"`make table1 PROFILE={run}` or `make table2 PROFILE={run}` writes them"
    return advice + (', and "published" are the paper\'s own' if run == "paper" else "")
