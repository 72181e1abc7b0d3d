"""The rig report as a person reads it: its files in results/runs/<profile>/, printed, with its notebook."""

from collections.abc import Sequence
from pathlib import Path

from replicate.engine.atomic_files import copy_file
from replicate.engine.paths import display_path
from replicate.report import manifest
from replicate.report.notebooks import run_notebook
from replicate.report.publication import CharacterResult, alone, by_character, facts_of, readable, results_folder
from replicate.report.results import over_seeds, read_results, write_results
from replicate.report.tables import as_text
from replicate.targets.rig_report.character_report import NAME, ROWS
from replicate.targets.rig_report.report_tables import report_table


def publish(results: Sequence[CharacterResult]) -> None:
    """Write the report of some characters to the profile's folder, print it, and execute its notebook if it is stale.

    Of several seeds the means are written, and the figure and pairs of the first. Results of characters that are not
    among them stay, as far as they are whole.
    """
    profile = results[0].config.profile
    folder, groups = results_folder(profile), by_character(results)
    with alone(folder):
        rows = readable(read_results, folder / ROWS) or []
        entries = manifest.entries(folder, NAME)
        facts = {c: own for c, own in entries.items() if c not in groups and _is_whole(folder, own, rows, c)}
        rows = [row for row in rows if row.character in facts]
        for character, each in groups.items():
            rows += over_seeds([read_results(one.folder / ROWS) for one in each])
            files = _copy(each[0].folder, folder, character, entries.get(character, {}).get("files", ()))
            facts[character] = {**facts_of(each, rows[-1].run), "files": files}
        write_results(folder / ROWS, rows)
        manifest.write_entries(folder, NAME, dict(sorted(facts.items())))
        run_notebook(NAME, profile)
    print(as_text(report_table(rows)))
    pictures = ", ".join(f"{NAME}_{character}.png" for character in groups)
    print(f"written to {display_path(folder)}: {ROWS}, {pictures}, {manifest.NAME}, and {NAME}.ipynb to read them in")


def _is_whole(folder: Path, facts: dict, rows: Sequence, character: str) -> bool:
    """Return whether a character's rows are of the run that the manifest names, and its files are there."""
    runs = {row.run for row in rows if row.character == character}
    return runs == {facts.get("run")} and all((folder / file).is_file() for file in facts.get("files", ["?"]))


def _copy(source: Path, folder: Path, character: str, before: Sequence[str]) -> list[str]:
    """Copy a character's figure and pairs, remove what it had besides, and return the names."""
    names = sorted(file.name for file in source.glob(f"{NAME}_{character}*") if file.is_file())
    for name in set(before) - set(names):
        (folder / name).unlink(missing_ok=True)
    for name in names:
        copy_file(source / name, folder / name)
    return names
