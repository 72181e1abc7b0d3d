"""Rows of some characters' artefacts in one CSV of results, with files beside them and a notebook to read them in."""

from collections.abc import Callable, Sequence
from pathlib import Path

from replicate.engine.atomic_files import copy_file
from replicate.report import manifest
from replicate.report.publication import CharacterResult, alone, by_character, facts_of, readable, results_folder
from replicate.report.results import Row, over_seeds, read_results, write_results


def publish_rows(
    name: str,
    results: Sequence[CharacterResult],
    compare: Callable[[Sequence[Row], Sequence[Row]], Sequence[Row]] | None = None,
) -> list[Row]:
    """Write a target's rows of some characters to the profile's folder, execute its notebook, return all of its rows.

    name: the target's; artefacts and results have a file name.csv, and beside it files called name_character…, if any.
    compare: (rows that were there, new rows of a character) → more rows, which are written beside the new ones.
    Of several seeds the means are written, and the files of the first. Results of characters that are not among them
    stay, as far as they are whole and of the run that the manifest names.
    """
    from replicate.report.notebooks import run_notebook

    profile, file = results[0].config.profile, f"{name}.csv"
    folder, groups = results_folder(profile), by_character(results)
    with alone(folder):
        before = manifest.entries(folder, name)
        earlier = readable(read_results, folder / file) or []
        facts = {c: own for c, own in before.items() if c not in groups and _is_whole(folder, own, earlier, c)}
        rows = [row for row in earlier if row.character in facts]
        for character, each in groups.items():
            new = over_seeds([read_results(one.folder / file) for one in each])
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
    """Copy the files whose names begin with a stem, remove what there was besides, and return the names."""
    names = sorted(file.name for file in source.glob(f"{stem}*") if file.is_file())
    for name in set(before) - set(names):
        (folder / name).unlink(missing_ok=True)
    for name in names:
        copy_file(source / name, folder / name)
    return names
