"""Table 2 among the committed results: a run's seeds and methods replace a character's or join them."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from replicate.base import paths
from replicate.base.exceptions import InputError
from replicate.benchmarks.common import merge
from replicate.cli.running import duration, known_times, times_s, wall_s
from replicate.config import resolve
from replicate.engine.stage import in_order
from replicate.methods import method_registry
from replicate.methods.method_registry import choose, sections
from replicate.methods.plan import Plan
from replicate.report import manifest
from replicate.report.results import (
    Row,
    joined,
    joint_run,
    of_character,
    over_seeds,
    read_results,
    read_seeds,
    where,
    write_seeds,
)
from replicate.report.tables import Table
from replicate.targets.table2 import stages
from replicate.targets.table2.rows import ROWS, SEEDS
from replicate.targets.table3 import FILE
from replicate.targets.table3.rows import GRAPHICS

TARGET = "table2"


def shared_characters(run: Path, into: Path | None = None) -> list[str]:
    """Return the characters with a Table 2 in a run and among the committed results, so that seeds can be joined.

    into: the folder of the committed results, REFERENCE by default. Raises InputError if configurations differ in more
    than the seed. Sections of methods may differ if the run has all committed seeds of the method, or none.
    """
    folders = (into or paths.REFERENCE, run)
    committed, of_run = (manifest.entries(folder, TARGET) for folder in folders)
    seeds = [_seeds_of(folder) for folder in folders]
    both = [name for name in of_run if name in committed]
    for name in both:
        old, new = (_seeds_of_methods(of_character(rows, name)) for rows in seeds)
        anew = {method for method, its_seeds in new.items() if old.get(method, set()) <= its_seeds}
        for key in ("profile", "split", "configuration"):
            entries = (_without(entry[name].get(key), anew | _sections_of_others(new)) for entry in (committed, of_run))
            if difference := next(differences(key, *entries), None):
                raise InputError(f"{name}: its seeds can't join the committed ones, since {difference}")
    return both


def differences(key: str, committed: object, new: object) -> Iterator[str]:
    """Yield a phrase for each value that both configurations have and that differs, also inside nested tables."""
    if isinstance(committed, dict) and isinstance(new, dict):
        for name in sorted(committed.keys() & new.keys()):
            yield from differences(name if key == "configuration" else f"{key}.{name}", committed[name], new[name])
    elif committed != new and committed is not None and new is not None:
        yield f"{key} is {new!r} here and {committed!r} there"


def put_table2(run: Path, shared: Collection[str], into: Path | None = None) -> list[Path]:
    """Put the numbers and manifest of a run's Table 2 among the committed results; return the files.

    Each character's seeds replace the committed ones; those of the shared characters join them. In a seed of both the
    run's methods replace the committed ones, and other methods stay. Characters that the run lacks stay.

    into: the folder of the committed results, REFERENCE by default.
    """
    into = into or paths.REFERENCE
    seeds, of_run = (_seeds_of(folder) for folder in (into, run))
    entries = manifest.entries(into, TARGET)
    table, single = into / ROWS, into / SEEDS
    for character, facts in manifest.entries(run, TARGET).items():
        by_seed = of_character(seeds, character) if character in shared else {}
        new = of_character(of_run, character)
        by_seed |= {seed: _beside(by_seed.get(seed, ()), rows) for seed, rows in new.items()}
        rows = over_seeds([by_seed[seed] for seed in sorted(by_seed)])
        run_name = joint_run(rows)
        rows = [replace(row, run=run_name) for row in rows]
        merge(table, rows, lambda row, name=character: row.character != name)
        seeds = joined(where(seeds, character.__ne__), by_seed)
        earlier = entries.get(character)
        if character in shared:
            others = _sections_of_others(_seeds_of_methods(new))
            kept = {name: section for name, section in earlier["configuration"].items() if name in others}
            facts = manifest.with_earlier(facts, earlier, run_name)
            facts["configuration"] = facts["configuration"] | kept
        entries[character] = facts
    write_seeds(single, seeds)
    manifest.write_entries(into, TARGET, dict(sorted(entries.items())))
    return [table, single]


def _seeds_of_methods(seeds: Mapping[int, Sequence[Row]]) -> dict[str, set[int]]:
    """Return the seeds of each method."""
    found: dict[str, set[int]] = {}
    for seed, rows in seeds.items():
        for row in rows:
            found.setdefault(row.method, set()).add(seed)
    return found


def _sections_of_others(methods: Collection[str]) -> set[str]:
    """Return the sections of the configuration that belong to a single method other than these."""
    return {name for name, method in method_registry.methods().items() if method.default_section} - set(methods)


def _without(facts: object, names: Collection[str]) -> object:
    """Return a configuration without some of its sections; return anything else unchanged."""
    return {name: value for name, value in facts.items() if name not in names} if isinstance(facts, dict) else facts


def _beside(committed: Sequence[Row], new: Sequence[Row]) -> list[Row]:
    """Return the new rows of a character's seed, and the committed rows of the other methods."""
    methods = {row.method for row in new}
    return [*new, *(row for row in committed if row.method not in methods)]


def _seeds_of(folder: Path) -> dict[int, list]:
    """Return the rows of each seed in a folder of results; with a single seed they are those of the table.

    Raises InputError for a character with several seeds whose rows by seed are missing.
    """
    file = folder / SEEDS
    seeds = read_seeds(file) if file.is_file() else {}
    there = {row.character for rows in seeds.values() for row in rows}
    table = read_results(folder / ROWS) if (folder / ROWS).is_file() else []
    for character, facts in manifest.entries(folder, TARGET).items():
        if character not in there:
            if len(facts["seeds"]) > 1:
                raise InputError(f"{file}: it lacks {character}; `make table2` writes each of its seeds there")
            seeds = joined(seeds, {facts["seeds"][0]: [row for row in table if row.character == character]})
    return seeds


# Table 3 of a run on a machine with a GPU, which is committed in a separate folder.

TIMED_TARGET = "table3"


def is_of_gpu(run: Path) -> bool:
    """Return whether a run's Table 3 has times on a GPU. Raises InputError if only some characters have them."""
    rows = read_results(run / FILE) if (run / FILE).is_file() else []
    every = dict.fromkeys(row.character for row in rows)
    timed = {row.character for row in rows if row.metric == f"time_{GRAPHICS}"}
    if timed and (others := [name for name in every if name not in timed]):
        where = paths.display_path(run)
        raise InputError(f"{where}: Table 3 has no times on a GPU for {', '.join(others)}: publish these apart")
    return bool(timed)


def put_gpu_times(run: Path, into: Path) -> list[Path]:
    """Put the numbers and manifest of a run's Table 3 into a folder, where other characters stay; return the file."""
    rows = read_results(run / FILE)
    characters = {row.character for row in rows}
    into.mkdir(parents=True, exist_ok=True)
    merge(into / FILE, rows, lambda row: row.character not in characters)
    entries = manifest.entries(into, TIMED_TARGET) | manifest.entries(run, TIMED_TARGET)
    manifest.write_entries(into, TIMED_TARGET, dict(sorted(entries.items())))
    return [into / FILE]


# About how long Table 2 takes, by profile and character, from the times of the committed results.

CHARACTERS = ("teen", "woman", "dragon", "toon")
WORKERS = 2
COMMANDS = (
    ("make table2 PROFILE=quick", "quick", ()),
    ("make table2", "laptop", ()),
    ("make table2 METHODS=all", "laptop", ("all",)),
    ("make table2 PROFILE=paper", "paper", ()),
)


def times_card(folder: Path) -> Table:
    """Return how long `make table2` takes from an empty cache, by the estimate that it prints before it starts.

    folder: the results whose manifest has the times of stages.
    """
    known = known_times(folder)

    def cell(character: str, profile: str, names: tuple[str, ...]) -> str:
        config = resolve(character, profile, sections=sections(profile))
        graph = in_order(stages(Plan(config), choose(names, config)))
        return duration(wall_s(graph, times_s(graph, known), WORKERS))

    body = [(f"`{command}`", *(cell(each, *how) for each in CHARACTERS)) for command, *how in COMMANDS]
    note = f"One seed, on {WORKERS} cores. Pictures and notebooks come on top."
    return Table("About how long Table 2 takes", (("", *CHARACTERS),), tuple(body), (note,))
