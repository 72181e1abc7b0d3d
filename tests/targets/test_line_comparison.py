"""Networks with and without a straight line beside them: which are compared, the table and the chart."""

import pytest

from replicate.report.results import Row
from replicate.report.tables import as_latex
from replicate.targets.table2.charts import compared, line_chart, line_table

ERRORS = {"coarse": 4.0, "refined": 2.0, "dense": 1.0, "linear": 3.0, "coarse_line": 0.8, "refined_line": 0.6}


def rows(errors: dict[str, float], character: str = "teen") -> list[Row]:
    facts = None, 1, 100, "laptop", "r"
    units = {"vertex_error_mean": ("mm", 1), "normal_error_mean": ("deg", 10), "model_size": ("MB", 3)}
    return [
        Row("table2", character, method, metric, unit, factor * error, *facts)
        for method, error in errors.items()
        for metric, (unit, factor) in units.items()
    ]


def test_only_networks_with_both_rows_are_compared():
    assert compared(rows(ERRORS), "teen") == ["coarse", "refined"] and compared(rows(ERRORS), "woman") == []
    alone = {"coarse": 4.0, "dense_line": 1.0}
    assert line_table(rows(alone), "teen") is None and line_chart(rows(alone)) is None


def test_the_table_has_both_errors_and_what_becomes_of_a_ranking():
    table = line_table(rows(ERRORS | {"dense_line": 1.2}), "teen")
    lines = {line[0]: line[1:] for line in table.body if line}
    assert lines["Coarse"] == ("4.00", "0.80", "40.00", "8.00", "12.00", "2.40")
    assert lines["Linear"] == ("3.00", "", "30.00", "", "9.00", "")
    assert lines["Refined / Coarse"] == ("0.50", "0.75", "0.50", "0.75", "", "")
    assert lines["Refined / Dense"] == ("2.00", "0.50", "2.00", "0.50", "", "")
    assert "Refined / Dense" not in {line[0] for line in line_table(rows(ERRORS), "teen").body if line}
    assert "with a line" in as_latex(table)


def test_the_chart_has_an_arrow_for_each_network_and_a_cross_for_the_line():
    both = [*rows(ERRORS), *rows({"dense": 1.0, "dense_line": 2.0, "linear": 3.0}, "woman")]
    figure, words = line_chart(both)
    distance, normals = figure.axes
    arrows = [(text.xyann, text.xy) for text in distance.texts]
    assert arrows == [((4.0, 0), (0.8, 0)), ((2.0, 1), (0.6, 1)), ((1.0, 3), (2.0, 3))]
    crosses = [line.get_xdata()[0] for line in normals.lines if line.get_marker() == "x"]
    assert crosses == pytest.approx([30.0, 30.0, 30.0])
    assert [text.get_text() for text in distance.get_yticklabels()] == ["teen: Coarse", "teen: Refined", "woman: Dense"]
    assert "woman, Dense: 10.00 to 20.00 deg" in words.alt
