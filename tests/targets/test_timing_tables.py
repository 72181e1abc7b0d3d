"""Table 3 printed: ours beside the paper's, speed-ups, disturbed times, and the chart of errors against costs."""

import pytest

from replicate.engine.paths import PAPER
from replicate.report.results import Row, read_results
from replicate.report.tables import as_text
from replicate.targets.table3.frontier_chart import frontier_chart
from replicate.targets.table3.timing_tables import NO_RIG, details_table, label_of, tables3, timing_table

MS = {"rig_nodes": 60.0, "rig": 6.0, "coarse": 4.0, "coarse_plain": 8.0, "dense": 2.0, "rigid_step": 0.25}


def rows(character="teen", p95=1.2):
    def row(table, method, metric, unit, value, poses=1_000):
        return Row(table, character, method, metric, unit, value, None, 1, poses, "laptop", "r")

    made = [row("table3", "rig", "cores", "count", 2.0, None)]
    for name, ms in MS.items():
        for cores, share in (("all_cores", 1.0), ("one_core", 1.5)):
            kinds = {"time": ms, "median": ms, "p05": 0.9 * ms, "p95": p95 * ms}
            made += [row("table3", name, f"{kind}_{cores}", "ms", share * value) for kind, value in kinds.items()]
    made += [row("table3", "coarse", "multiplications", "count", 5e7, None)]
    made += [row("table3", name, "model_size", "MB", 5.0, None) for name in ("coarse", "dense")]
    return [*made, *(row("table2", name, "normal_error_mean", "deg", 1.0) for name in ("coarse", "dense"))]


def test_the_papers_times_stand_beside_ours():
    table = timing_table(rows(), read_results(PAPER / "table3.csv"))
    assert table.headers[0] == ("", "teen", "", "Hiccup")
    assert ("The rig, node by node", "90.00", "60.00", "75.0") in table.body
    assert ("Coarse", "6.00", "4.00", "2.9") in table.body and ("Coarse, plain", "12.00", "8.00", "–") in table.body
    assert table.body[0][0] == label_of("rig_nodes") and table.body[-1][0] == "Rigid step alone"
    assert any("1,000 evaluations" in note for note in table.notes)


def test_a_disturbed_time_is_marked():
    body = {line[0]: line[1] for line in timing_table(rows(p95=1.6), []).body}
    assert body["Dense"] == "~3.00"
    assert "~" not in "".join(map("".join, timing_table(rows(), []).body))


def test_a_rig_without_a_function_has_a_dash_and_a_note_says_why():
    known_by_samples = [row for row in rows("mine") if row.method not in ("rig", "rig_nodes") or row.metric == "cores"]
    for table in tables3(known_by_samples, [])[:2]:
        body = {line[0]: line[1:] for line in table.body}
        assert set(body["The rig, compiled"]) == {"–"} and NO_RIG in table.notes
    both = timing_table([*rows(), *known_by_samples], [])
    assert {line[0]: line[4] for line in both.body}["The rig, compiled"] == "–"
    assert NO_RIG not in timing_table(rows(), []).notes


def test_speed_ups_are_over_both_evaluations_of_the_rig():
    body = {line[0]: line[1:] for line in details_table(rows(), "teen").body}
    assert body["Dense"][:2] == ("30.00", "3.00") and body["The rig, compiled"][:2] == ("10.00", "1.00")
    assert body["Coarse, plain"][5] == "50.0" == body["Coarse"][5] and body["Coarse"][6] == "5.00"
    assert len(tables3([*rows(), *rows("toon")], [])) == 3
    assert all(as_text(each) for each in tables3(rows(), []))


def test_the_chart_has_what_has_error_time_and_size():
    figure, words = frontier_chart(rows(), rows(), "teen")
    assert len(figure.axes) == 2 and "Coarse: 4.00 ms, 1.00°" in words.alt and "Dense: 5.00 MB" in words.alt
    assert "The rig" not in words.alt
    assert frontier_chart(rows(), [], "teen") is None


@pytest.mark.parametrize(("name", "label"), [("rig", "The rig, compiled"), ("dense", "Dense")])
def test_labels(name, label):
    assert label_of(name) == label
