"""One character's part of Table 2, gathered from the methods' errors."""

from collections.abc import Mapping
from pathlib import Path

from replicate.methods import measurement
from replicate.report.error_rows import error_rows
from replicate.report.pose_record import pose_file, save_pose
from replicate.report.results import Row, write_results
from replicate.report.run_name import run_name
from replicate.report.training_curves import Curve, read_log, write_curves
from replicate.targets.shown_records import load_records
from replicate.targets.table2.table_numbers import TableNumbers
from replicate.targets.table2.training_times import training_s

ROWS, SEEDS, CURVES = "table2.csv", "table2_seeds.csv", "table2_curves.csv"


def write_all(settings: TableNumbers, inputs: Mapping[str, Path], out: Path) -> None:
    """Write a character's rows, curves and poses to a folder.

    inputs: the folders of rig, samples, "wrinkled", "ranked", and of the errors and typical poses of every method.
    """
    write_results(out / ROWS, rows_of(settings, inputs))
    write_curves(out / CURVES, curves_of(settings.character, inputs))
    for choice, record in load_records(settings.character, inputs).items():
        save_pose(pose_file(out, settings.character, choice), record)


def rows_of(settings: TableNumbers, inputs: Mapping[str, Path]) -> list[Row]:
    """Return a character's rows: each method's errors, its size, its training, and what else it has to say."""
    run = run_name(inputs)
    rows = []
    for method, folder in measurement.error_folders(inputs).items():
        rows += error_rows(settings.character, {method: measurement.load_errors(folder)}, settings.profile, run)
        seconds = training_s(folder)
        training = [("training", "s", seconds)] if seconds is not None else []
        for metric, unit, value in (*measurement.load_numbers(folder), *training):
            table = "table2_segments" if "[" in metric else "table2"
            seeds = None if metric.startswith("texels") else 1  # a fact about charts, not about a training
            facts = (method, metric, unit, value, None, seeds, None, settings.profile, run)
            rows.append(Row(table, settings.character, *facts))
    return rows


def curves_of(character: str, inputs: Mapping[str, Path]) -> dict[tuple[str, str], Curve]:
    """Return the validation errors of a character's trainings, step by step."""
    files = {method: measurement.load_curve(folder) for method, folder in measurement.error_folders(inputs).items()}
    return {(character, method): read_log(file) for method, file in files.items() if file}
