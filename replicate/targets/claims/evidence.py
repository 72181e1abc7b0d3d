"""The rows that claims are judged by: of a run where it has them, else of the committed results."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from data_recipes import recipe_paths
from replicate.benchmarks.common import PROFILE as BENCH
from replicate.engine import paths
from replicate.report.cast import STANDS_FOR, order_of
from replicate.report.manifest import command_of
from replicate.report.results import Row, read_results
from replicate.report.seed_results import Seeds, joined, read_seeds, where
from replicate.targets.claims.verdict_rules import Number
from replicate.targets.table2.character_part import SEEDS as SINGLE_SEEDS
from replicate.targets.table3.gpu_machine import GPU_TABLE, beside, gpu_machine_rows

TABLES = (
    "table1",
    "table2",
    "table3",
    "table4",
    "figure13",
    "bench_training",
    "bench_ladder",
)  # the files, without .csv
SEGMENTS = "table2_segments"  # a table of its own in table2.csv
QUANTITIES = {"vertex": ("distance", "mm"), "normal": ("normal error", "deg")}


class MissingNumber(LookupError):
    """There is no row of a number that a claim needs; the message is a sentence that names it and what makes it."""


class Evidence:
    """The rows of some characters, ours or the paper's, to be looked up, and the folder that each table is from."""

    def __init__(
        self, rows: Iterable[Row], places: dict[tuple[str, str], str] | None = None, seeds: Seeds | None = None
    ):
        """Take rows, of which no two are of the same number.

        places: (table, character) → a folder's name. seeds: seed → the rows that some of these are the means of.
        """
        self.rows = {row.key: row for row in rows}
        self.places = places or {}
        self.by_seed: dict[tuple, dict[int, float]] = {}
        for seed, single in (seeds or {}).items():
            for row in single:
                self.by_seed.setdefault(row.key, {})[seed] = row.value

    def characters(self) -> list[str]:
        """Return those that stand for the paper's four, and the others that Table 2 has, in the order of tables."""
        others = {row.character for row in self.rows.values() if row.table == "table2"}
        return sorted({*STANDS_FOR, *others}, key=order_of)

    def number(self, table: str, character: str, method: str, metric: str, name: str = "") -> Number:
        """Return a number; name: what sentences call it, else as the method. Raises MissingNumber without a row."""
        row = self.rows.get((table, character, method, metric))
        if row is None:
            target = "table2" if table == SEGMENTS else table
            which, whose = f"no {metric} of {method} for {character}", character
            if is_from_elsewhere(character):
                whose = f"<recipe or folder of {character}>"
            raise MissingNumber(f"{target}.csv has {which}; `make {command_of(target)} CHARACTERS={whose}` writes it.")
        by_seed = self.by_seed.get(row.key, {})
        by_seed = by_seed if len(by_seed) == row.seeds else {}  # those of another run say nothing about this one
        return Number(name or method.replace("lbs", "LBS "), row.value, row.sd, (row,), by_seed)

    def error(self, character: str, method: str, kind: str) -> Number:
        """Return a method's mean error over the test poses. kind: "vertex", in mm, or "normal", in degrees."""
        return self.number("table2", character, method, f"{kind}_error_mean")

    def place(self, rows: Iterable[Row]) -> str:
        """Return the names of the folders that some rows are from."""
        keys = {(row.table.replace(SEGMENTS, "table2"), row.character) for row in rows}
        return ", ".join(sorted({self.places[key] for key in keys if key in self.places}))


def is_from_elsewhere(character: str) -> bool:
    """Return whether a character of some results has no recipe here: it is named by its folder, not by this name."""
    name, _ = recipe_paths.split_character(character)
    return name not in STANDS_FOR and not recipe_paths.recipe_file(name).is_file()


def folders_of(name: str) -> list[Path]:
    """Return where evidence of some results is looked for, in order. name: "reference", or the profile of a run."""
    if name == "reference":
        return [paths.REFERENCE]
    return [paths.run_folder(name), paths.run_folder(BENCH), paths.REFERENCE]


def gather(folders: Sequence[Path]) -> Evidence:
    """Return, for each table and character, the rows of the first folder that has some, and each seed's where known.

    With the committed results come the times by the machine with a GPU, as a table of their own. Raises InputError for
    a file that is no table of results.
    """
    rows: list[Row] = []
    places: dict[tuple[str, str], str] = {}
    seeds: dict[int, list[Row]] = {}
    for table in TABLES:
        for folder in folders:
            file = folder / f"{table}.csv"
            new = read_results(file) if file.is_file() else []
            new = [row for row in new if (table, row.character) not in places]
            characters = dict.fromkeys(row.character for row in new)  # in their order, so that pages repeat exactly
            rows += new
            places |= {(table, character): folder.name for character in characters}
            single = folder / SINGLE_SEEDS
            if table == "table2" and characters and single.is_file():
                seeds = joined(seeds, where(read_seeds(single), characters.__contains__))
    if paths.REFERENCE in folders:
        on_gpu = beside(gpu_machine_rows("reference"))
        rows += on_gpu
        places |= {(GPU_TABLE, row.character): paths.GPU_MACHINE for row in on_gpu}
    return Evidence(rows, places, seeds)


def published() -> Evidence:
    """Return the paper's own numbers, by the names of its characters."""
    printed = ("table1", "table2", "table3", "table4")
    return Evidence(row for table in printed for row in read_results(paths.PAPER / f"{table}.csv"))


def stand_in(character: str) -> str:
    """Return the film character that one stands for, variants too, or "" for none; the paper's stand for themselves."""
    name = character.partition("@")[0]
    return name if name in STANDS_FOR.values() else STANDS_FOR.get(name, "")
