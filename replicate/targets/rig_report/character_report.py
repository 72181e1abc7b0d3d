"""One character's part of the rig report: its rows, its strongest pairs of controls, and its figure."""

from collections.abc import Mapping
from pathlib import Path

from replicate.artefacts import built_rig, control_influence
from replicate.drawing.panels import save_figure
from replicate.report.results import write_results
from replicate.targets.rig_report import control_pairs, regressions
from replicate.targets.rig_report.report_figure import Measurements, report_figure
from replicate.targets.rig_report.report_numbers import ReportNumbers
from replicate.targets.rig_report.report_rows import rows_of

NAME = "rig_report"
ROWS = f"{NAME}.csv"


def write_all(settings: ReportNumbers, inputs: Mapping[str, Path], folder: Path) -> None:
    """Write the rows, and a character's figure with its words and the pairs behind it."""
    rig, pairs = built_rig.load(inputs), control_pairs.load(inputs)
    rows, lines = rows_of(settings, inputs), control_pairs.strongest_pairs(rig, pairs)
    write_results(folder / ROWS, rows)
    control_pairs.write_pairs(folder / f"{NAME}_{settings.character}_pairs.csv", lines)
    facts, spectrum = regressions.load_facts(inputs), regressions.load_spectrum(inputs)
    numbers = Measurements(
        settings.character, rows, lines, spectrum, facts["curve"], control_influence.load(inputs).sum(1),
        pairs.vertex_ratio(),
    )  # fmt: skip
    figure, words = report_figure(rig.mesh, numbers)
    save_figure(figure, folder / f"{NAME}_{settings.character}.png", words)
