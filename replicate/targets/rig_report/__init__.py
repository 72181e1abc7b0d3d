"""Report how hard a rig is: what simple regressions, few components, small maps and sums of controls miss of it."""

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
from replicate.targets.rig_report import rows as rig_report_rows
from replicate.targets.rig_report.rows import ReportSettings, rows_of
from replicate.targets.rig_report.shown import Measurements, report_figure, report_table


def stages(plan: Plan, methods: Sequence[Method] = ()) -> list[Stage]:
    """Return the stages that measure one character, then the one that writes its rows and figure."""
    measuring = (rig_report_rows.fits_stage, rig_report_rows.pairs_stage, rig_report_rows.maps_stage)
    measured = [stage(plan) for stage in measuring]
    shared = (stage(plan) for stage in (artefacts.rig_stage, artefacts.influence_stage, artefacts.rigid_stage))
    settings = ReportSettings(plan.character, plan.config.profile, plan.config.seed)
    return [*measured, plan.stage("rig_report", write_report, settings, *shared, *measured)]


def write_report(context: StageContext) -> None:
    """Write one character's rows, its strongest pairs of controls and its figure."""
    write_all(context.config, context.inputs, context.out)


def run(options: argparse.Namespace) -> None:
    """Measure every character, publish and print the report."""
    publish(make(options, stages))


# One character's part of the report.

NAME = "rig_report"
ROWS = f"{NAME}.csv"


def write_all(settings: ReportSettings, inputs: Mapping[str, Path], folder: Path) -> None:
    """Write a character's rows, its strongest pairs of controls, and its figure with its words."""
    rig, pairs = artefacts.load_rig(inputs), rig_report_rows.load_pairs(inputs)
    rows, lines = rows_of(settings, inputs), rig_report_rows.strongest_pairs(rig, pairs)
    write_results(folder / ROWS, rows)
    rig_report_rows.write_pairs(folder / f"{NAME}_{settings.character}_pairs.csv", lines)
    facts, spectrum = rig_report_rows.load_facts(inputs), rig_report_rows.load_spectrum(inputs)
    measured = Measurements(
        settings.character, rows, lines, spectrum, facts["curve"], artefacts.load_influence(inputs).sum(1),
        pairs.vertex_ratio(),
    )  # fmt: skip
    figure, words = report_figure(rig.mesh, measured)
    save_figure(figure, folder / f"{NAME}_{settings.character}.png", words)


# The report of all characters: its files in results/runs/<profile>/, printed, with its notebook.


def publish(results: Sequence[CharacterResult]) -> None:
    """Write the report of some characters to the profile's folder, print it, and execute its notebook if it is stale.

    Several seeds are averaged; the figure and the pairs are of the first. Complete results of other characters stay.
    """
    print(as_text(report_table(publish_rows(NAME, results))))
    folder = display_path(results_folder(results[0].config.profile))
    pictures = ", ".join(f"{NAME}_{character}.png" for character in by_character(results))
    print(f"written to {folder}: {ROWS}, {pictures}, {manifest.NAME}, and {NAME}.ipynb to read them in")
