"""Copy finished artefacts into a folder of results, results/runs/<profile>/, next to those of other characters."""

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from data_recipes import recipe_paths
from replicate.base import paths
from replicate.base.files import check_creatable, check_writable, copy_file
from replicate.config import Config
from replicate.engine.stage import Stage
from replicate.engine.store import artefact_folder, check_lock, hold
from replicate.report import manifest
from replicate.report.results import Row, over_seeds, read_results, write_results

T = TypeVar("T")


@dataclass(frozen=True)
class CharacterResult:
    """A character's configuration, and the stage whose artefact is the result."""

    config: Config
    stage: Stage

    @property
    def folder(self) -> Path:
        """The artefact's folder."""
        return artefact_folder(self.stage.identifier)


def results_folder(profile: str) -> Path:
    """Create the folder of a profile's results and return it. Raises InputError if it can't be written."""
    folder = paths.run_folder(profile)
    check_writable(folder, "REPLICATE_RESULTS")
    check_lock(_lock(folder))
    return folder


def check_results_folder(profile: str) -> None:
    """Raise InputError if a profile's results can't be written; write nothing."""
    folder = paths.run_folder(profile)
    check_creatable(folder, "REPLICATE_RESULTS")
    check_lock(_lock(folder))


def by_character(results: Sequence[CharacterResult]) -> dict[str, list[CharacterResult]]:
    """Return the results by character: a list over its seeds."""
    groups: dict[str, list[CharacterResult]] = {}
    for result in results:
        groups.setdefault(recipe_paths.character_label(result.config.character), []).append(result)
    return groups


def facts_of(results: Sequence[CharacterResult], run: str) -> dict:
    """Return a manifest's facts about one character's results. run: the name of their run."""
    return manifest.facts_of([result.config for result in results], [result.stage for result in results], run)


def alone(folder: Path) -> contextlib.AbstractContextManager[None]:
    """Return a context manager that holds the lock of a folder of results, a file next to it."""

    def waiting() -> None:
        print(f"{paths.display_path(folder)}: being written by another process; waiting for it", flush=True)

    return hold(_lock(folder), waiting)


def _lock(folder: Path) -> Path:
    return folder.with_name(f".{folder.name}.lock")


def readable(read: Callable[[Path], T], file: Path) -> T | None:
    """Return what a file holds, or None if it is missing or damaged in whatever way."""
    try:
        return read(file)
    except Exception:
        return None


def publish_pictures(name: str, results: Sequence[CharacterResult]) -> None:
    """Copy a figure of some characters, with its words and numbers, to the profile's folder, and execute its notebook.

    name, results: as for `publish_files`.
    """
    from replicate.report.notebooks import run_notebook

    profile = results[0].config.profile
    folder, files = publish_files(name, results, lambda: run_notebook(name, profile))
    for character in by_character(results):
        pictures = [file for file in files[character] if file.endswith(".png")]
        print(
            f"written to {paths.display_path(folder)}: {', '.join(pictures)}, with their words and numbers beside them"
        )
    print(f"written to {paths.display_path(folder)}: {name}.ipynb to read them in")


def publish_files(
    name: str, results: Sequence[CharacterResult], finish: Callable[[], object] | None = None
) -> tuple[Path, dict[str, list[str]]]:
    """Copy a target's files of some characters to the profile's folder; return the folder, and each character's files.

    Of several seeds the first is taken. Files of other characters stay.

    name: the target's name; its files are called name_character…
    finish: called at the end, while the folder is still locked
    """
    folder, groups = results_folder(results[0].config.profile), by_character(results)
    with alone(folder):
        before = manifest.entries(folder, name)
        facts = {
            character: entry
            for character, entry in before.items()
            if character not in groups and all((folder / file).is_file() for file in entry.get("files", ["?"]))
        }
        for character, (first, *_) in groups.items():
            names = _copy(first.folder, folder, f"{name}_{character}", before.get(character, {}).get("files", ()))
            facts[character] = {**facts_of([first], first.stage.key), "files": names}
        manifest.write_entries(folder, name, dict(sorted(facts.items())))
        if finish:
            finish()
    return folder, {character: facts[character]["files"] for character in groups}


# Rows of some characters in one CSV file of results, with other files beside it and a notebook to read them in.


def publish_rows(
    name: str,
    results: Sequence[CharacterResult],
    compare: Callable[[Sequence[Row], Sequence[Row]], Sequence[Row]] | None = None,
) -> list[Row]:
    """Write a target's rows of some characters to the profile's folder, execute its notebook, return all of its rows.

    Several seeds are averaged; files are of the first. Results of other characters stay, if they are complete and of
    the run that the manifest names.

    name: the target's name; artefacts and results have a file name.csv, and perhaps others called name_character…
    compare: (rows that were there, new rows of a character) → more rows to write beside the new ones
    """
    from replicate.report.notebooks import run_notebook

    profile, file = results[0].config.profile, f"{name}.csv"
    folder, groups = results_folder(profile), by_character(results)
    with alone(folder):
        before = manifest.entries(folder, name)
        earlier = readable(read_results, folder / file) or []
        facts = {c: entry for c, entry in before.items() if c not in groups and _is_whole(folder, entry, earlier, c)}
        rows = [row for row in earlier if row.character in facts]
        for character, each in groups.items():
            new = over_seeds([read_results(result.folder / file) for result in each])
            rows += [*new, *(compare(earlier, new) if compare else ())]
            facts[character] = facts_of(each, rows[-1].run)
            names = _copy(each[0].folder, folder, f"{name}_{character}", before.get(character, {}).get("files", ()))
            facts[character] |= {"files": names} if names else {}
        write_results(folder / file, rows)
        manifest.write_entries(folder, name, dict(sorted(facts.items())))
        run_notebook(name, profile)
    return rows


def _is_whole(folder: Path, facts: dict, rows: Sequence[Row], character: str) -> bool:
    """Return whether a character's rows are of the run that the manifest names, and its files are there."""
    runs = {row.run for row in rows if row.character == character}
    return runs == {facts.get("run")} and all((folder / file).is_file() for file in facts.get("files", ()))


def _copy(source: Path, folder: Path, stem: str, before: Sequence[str]) -> list[str]:
    """Copy the files whose names begin with a stem, remove other files of `before`, and return the names."""
    names = sorted(file.name for file in source.glob(f"{stem}*") if file.is_file())
    for name in set(before) - set(names):
        (folder / name).unlink(missing_ok=True)
    for name in names:
        copy_file(source / name, folder / name)
    return names
