"""What a row costs: the time of the stages behind it, its multiplications, and the table that shows both."""

import json

import pytest
from sample_rows import cells_after, table2_rows

from replicate.engine.store import artefact_folder
from replicate.report.results import Row
from replicate.report.tables import as_text
from replicate.targets.table2.rows import training_s, work_table


@pytest.fixture
def artefact(cache):
    """A function that writes an artefact's manifest: its name, time, inputs' names, and more facts."""

    def write(name: str, wall_s: float, *inputs: str, **facts):
        module = "methods.artefacts" if name in ("rig", "samples") else "methods.toy"
        manifest = {"function": f"replicate.{module}:make", "wall_s": wall_s, "threads": 1, "resumed": False, **facts}
        manifest["inputs"] = {k: f"{i}-key" for i in inputs for k in (i, f"{i}-teen")}
        folder = artefact_folder(f"{name}-key")
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "manifest.json").write_text(json.dumps(manifest))
        return folder

    write("rig", 1000.0)
    write("samples", 500.0, "rig")
    return write


def test_training_is_all_that_a_row_builds_on_once_without_what_all_methods_share(artefact):
    artefact("line", 3.0, "samples")
    artefact("coarse", 40.0, "samples", "line")
    artefact("refined", 20.0, "coarse", "line", "samples", threads=2)
    assert training_s(artefact("errors_refined", 7.0, "rig", "coarse", "refined")) == 3 + 40 + 2 * 20
    assert training_s(artefact("errors_coarse", 7.0, "rig", "coarse")) == 43


def test_no_time_is_told_where_nothing_is_trained_or_a_part_of_it_is_lost(artefact):
    assert training_s(artefact("errors_neutral", 7.0, "rig", "samples")) is None
    artefact("dense", 12.0, "samples", resumed=True)
    artefact("compact", 1.0, "dense")
    assert training_s(artefact("errors_compact", 7.0, "compact")) is None
    assert training_s(artefact("errors_gone", 7.0, "nowhere")) is None


def row(method: str, metric: str, unit: str, value: float) -> Row:
    return Row("table2", "teen", method, metric, unit, value, None, 1, None, "quick", "r")


def test_the_table_has_a_line_for_each_method_that_costs_something():
    rows = [
        row("refined", "model_size", "MB", 8.125),
        row("refined", "multiplications", "count", 97_400_000.0),
        row("refined", "training", "s", 2223.6),
        row("lbs16", "multiplications", "count", 1_200_000.0),
        row("neutral", "multiplications", "count", 0.0),
    ]
    text = as_text(work_table(rows + table2_rows(), "teen"))
    assert cells_after(text, "Refined") == ["8.12", "97.40", "2,224"]
    assert cells_after(text, "LBS: 16 bones") == ["–", "1.20", "–"]
    assert cells_after(text, "Neutral pose") == ["–", "0.00", "–"]
    assert "Coarse" not in text and text.index("Refined") < text.index("LBS") < text.index("Neutral")


def test_results_of_before_the_count_have_no_such_table():
    assert work_table([*table2_rows(), row("refined", "model_size", "MB", 8.1)], "teen") is None
    assert work_table([row("refined", "multiplications", "count", 1.0)], "dragon") is None
