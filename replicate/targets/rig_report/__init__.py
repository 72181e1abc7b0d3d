"""How hard is a rig? What simple regressions, few components, small maps and sums of controls miss of its poses."""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

from replicate.base.paths import display_path
from replicate.cli.running import make
from replicate.drawing.panels import save_figure
from replicate.engine.stage import Stage, StageContext
from replicate.methods import artefacts
from replicate.methods.method import Method
from replicate.methods.plan import Plan
from replicate.report import manifest
from replicate.report.publication import CharacterResult, by_character, publish_rows, results_folder
from replicate.report.results import write_results
from replicate.report.tables import as_text
from replicate.targets.rig_report import rows
from replicate.targets.rig_report import rows as rig_report_rows
from replicate.targets.rig_report.rows import ReportNumbers, rows_of
from replicate.targets.rig_report.shown import Measurements, report_figure, report_table


def stages(plan: Plan, methods: Sequence[Method] = ()) -> list[Stage]:
    """Return the stage that holds one character's rows and figure, behind those that measure it."""
    measured = [stage(plan) for stage in (rows.fits_stage, rows.pairs_stage, rows.maps_stage)]
    shared = (stage(plan) for stage in (artefacts.rig_stage, artefacts.influence_stage, artefacts.rigid_stage))
    numbers = ReportNumbers(plan.character, plan.config.profile, plan.config.seed)
    return [*measured, plan.stage("rig_report", write_report, numbers, *shared, *measured)]


def write_report(context: StageContext) -> None:
    """Write one character's rows, its strongest pairs of controls and its figure."""
    write_all(context.config, context.inputs, context.out)


def run(options: argparse.Namespace) -> None:
    """Measure every character, publish and print the report."""
    publish(make(options, stages))


# One character's part of the rig report: its rows, its strongest pairs of controls, and its figure.

NAME = "rig_report"
ROWS = f"{NAME}.csv"


def write_all(settings: ReportNumbers, inputs: Mapping[str, Path], folder: Path) -> None:
    """Write the rows, and a character's figure with its words and the pairs behind it."""
    rig, pairs = artefacts.load_rig(inputs), rig_report_rows.load_pairs(inputs)
    rows, lines = rows_of(settings, inputs), rig_report_rows.strongest_pairs(rig, pairs)
    write_results(folder / ROWS, rows)
    rig_report_rows.write_pairs(folder / f"{NAME}_{settings.character}_pairs.csv", lines)
    facts, spectrum = rig_report_rows.load_facts(inputs), rig_report_rows.load_spectrum(inputs)
    numbers = Measurements(
        settings.character, rows, lines, spectrum, facts["curve"], artefacts.load_influence(inputs).sum(1),
        pairs.vertex_ratio(),
    )  # fmt: skip
    figure, words = report_figure(rig.mesh, numbers)
    save_figure(figure, folder / f"{NAME}_{settings.character}.png", words)


# The rig report as a person reads it: its files in results/runs/<profile>/, printed, with its notebook.


def publish(results: Sequence[CharacterResult]) -> None:
    """Write the report of some characters to the profile's folder, print it, and execute its notebook if it is stale.

    Of several seeds the means are written, and the figure and pairs of the first. Results of characters that are not
    among them stay, as far as they are whole.
    """
    print(as_text(report_table(publish_rows(NAME, results))))
    folder = display_path(results_folder(results[0].config.profile))
    pictures = ", ".join(f"{NAME}_{character}.png" for character in by_character(results))
    print(f"written to {folder}: {ROWS}, {pictures}, {manifest.NAME}, and {NAME}.ipynb to read them in")
