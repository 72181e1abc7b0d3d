"""Tables that are rows alone: from the artefacts of some characters to one CSV of results, with its notebook."""

from collections.abc import Sequence

from replicate.report import manifest
from replicate.report.publication import CharacterResult, alone, by_character, facts_of, readable, results_folder
from replicate.report.results import Row, over_seeds, read_results, write_results


def publish_rows(name: str, results: Sequence[CharacterResult]) -> list[Row]:
    """Write a target's rows of some characters to the profile's folder, execute its notebook, return all of its rows.

    name: the target's; artefacts and results have a file name.csv. Of several seeds the means are written. Results of
    characters that are not among them stay, as far as they are of the run that the manifest names.
    """
    from replicate.report.notebooks import run_notebook

    profile, file = results[0].config.profile, f"{name}.csv"
    folder, groups = results_folder(profile), by_character(results)
    with alone(folder):
        facts = manifest.entries(folder, name)
        rows = readable(read_results, folder / file) or []
        runs = {character: {row.run for row in rows if row.character == character} for character in facts}
        facts = {
            character: own
            for character, own in facts.items()
            if runs[character] == {own.get("run")} and character not in groups
        }
        rows = [row for row in rows if row.character in facts]
        for character, each in groups.items():
            rows += over_seeds([read_results(one.folder / file) for one in each])
            facts[character] = facts_of(each, rows[-1].run)
        write_results(folder / file, rows)
        manifest.write_entries(folder, name, dict(sorted(facts.items())))
        run_notebook(name, profile)
    return rows
