"""The rig report as a person reads it: its files in results/runs/<profile>/, printed, with its notebook."""

from collections.abc import Sequence

from replicate.engine.paths import display_path
from replicate.report import manifest
from replicate.report.publication import CharacterResult, by_character, results_folder
from replicate.report.row_publication import publish_rows
from replicate.report.tables import as_text
from replicate.targets.rig_report.character_report import NAME, ROWS
from replicate.targets.rig_report.report_tables import report_table


def publish(results: Sequence[CharacterResult]) -> None:
    """Write the report of some characters to the profile's folder, print it, and execute its notebook if it is stale.

    Of several seeds the means are written, and the figure and pairs of the first. Results of characters that are not
    among them stay, as far as they are whole.
    """
    print(as_text(report_table(publish_rows(NAME, results))))
    folder = display_path(results_folder(results[0].config.profile))
    pictures = ", ".join(f"{NAME}_{character}.png" for character in by_character(results))
    print(f"written to {folder}: {ROWS}, {pictures}, {manifest.NAME}, and {NAME}.ipynb to read them in")
