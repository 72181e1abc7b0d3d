"""Table 3 printed: ours beside the paper's, speed-ups, disturbed times, and the chart of errors against costs."""

from dataclasses import replace

import pytest
from timed_rows import timed_rows as rows

from replicate.base.paths import PAPER, REFERENCE
from replicate.report.results import Row, read_results
from replicate.report.tables import as_text
from replicate.targets.table3.rows import best_row
from replicate.targets.table3.shown import (
    NO_RIG,
    backends_tables,
    details_table,
    frontier_chart,
    gpu_tables,
    label_of,
    speed_table,
    tables3,
    timing_table,
)
from replicate.timing.single_poses import CHANGE, parted


def test_the_papers_times_stand_beside_ours():
    table = timing_table(rows(), read_results(PAPER / "table3.csv"))
    assert table.headers[0] == ("", "teen", "", "Hiccup")
    assert ("The rig, node by node", "90.00", "60.00", "75.0") in table.body
    assert ("Coarse", "6.00", "4.00", "2.9") in table.body and ("Dense", "1.50", "1.00", "2.1") in table.body
    assert not any("plain" in line[0] or "fast" in line[0] for line in table.body)
    assert table.body[0][0] == label_of("rig_nodes") and table.body[-1][0] == "Rigid step alone"
    assert any("1,000 evaluations" in note for note in table.notes)


def test_a_disturbed_time_is_marked():
    body = {line[0]: line[1] for line in timing_table(rows(p95=1.6), []).body}
    assert body["Dense"] == "~1.50"
    assert "~" not in "".join(map("".join, timing_table(rows(), []).body))


def test_a_rig_without_a_function_has_a_dash_and_a_note_says_why():
    known_by_samples = [row for row in rows("mine") if row.method not in ("rig", "rig_nodes") or row.metric == "cores"]
    first, *_, details = tables3(known_by_samples, [])
    for table in (first, details):
        body = {line[0]: line[1:] for line in table.body}
        assert set(body["The rig, compiled"]) == {"–"} and NO_RIG in table.notes
    both = timing_table([*rows(), *known_by_samples], [])
    assert {line[0]: line[4] for line in both.body}["The rig, compiled"] == "–"
    assert NO_RIG not in timing_table(rows(), []).notes


def test_speed_ups_are_over_both_evaluations_of_the_rig():
    body = {line[0]: line[1:] for line in details_table(rows(), "teen").body}
    assert body["Dense"][:4] == ("60.00", "6.00", "0.90", "1.00") and body["The rig, compiled"][:2] == ("10.00", "1.00")
    assert body["Coarse"][5:] == ("50.0", "5.00")
    assert len(tables3([*rows(), *rows("toon")], [])) == 5
    assert all(as_text(each) for each in tables3(rows(), []))


def test_the_speed_ups_are_those_of_every_methods_best_evaluation():
    table = speed_table([*rows(), *rows("toon")])
    assert table.headers[0] == ("", "teen", "", "toon", "")
    assert table.body[1] == ("Dense", "60.00", "6.00", "60.00", "6.00")
    assert [line[0] for line in table.body] == ["Coarse", "Dense"]
    alone = [row for row in rows() if row.method != "rig_nodes"]
    assert speed_table(alone).body[0] == ("Coarse", "–", "1.50"), "a rig without nodes"


def test_backends_stand_side_by_side_and_the_best_exact_one_counts():
    (table,) = backends_tables(rows(), "teen")
    assert table.headers == (("", "plain", "the suite's", "fast", "fast, 16 bits", "best over torch"),)
    body = {line[0]: line[1:] for line in table.body}
    assert body["Coarse"] == ("12.00", "6.00", "–", "–", "2.0")
    assert body["Dense"] == ("–", "3.00", "1.50", "0.75", "2.0"), "weights in 16 bits move vertices"
    assert "The rig, compiled" not in body and "Rigid step alone" not in body
    notes = " ".join(table.notes)
    assert "up to 0.004 mm" in notes and "within 0.0002 mm" in notes and "ONNX" not in notes


def gpu_rows(character="teen", **times):
    facts = None, 1, 1_000, "laptop", "r"
    return [Row("table3", character, name, "time_gpu", "ms", ms, *facts) for name, ms in times.items()]


def test_times_on_a_gpu_have_a_table_beside_the_cpus_and_the_papers():
    timed = [*rows(), *gpu_rows(coarse_gpu=3.0, coarse_gpu_graph=0.7, dense_gpu=0.9)]
    assert gpu_tables(rows(), []) == [] and timing_table(timed, []) == timing_table(rows(), [])
    (table,) = gpu_tables(timed, read_results(PAPER / "table3.csv"))
    assert table.headers == (("", "teen", "", "Hiccup", ""), ("", "CPU", "GPU", "paper, CPU", "paper, GPU"))
    assert table.body == (("Coarse", "4.00", "0.70", "2.9", "6.4"), ("Dense", "1.00", "0.90", "2.1", "2.6"))
    backends = backends_tables(timed, "teen")[-1]
    assert backends.headers == (("", "torch on a GPU", "CUDA graph", "best over torch"),)
    assert backends.body == (("Coarse", "3.00", "0.70", "4.3"), ("Dense", "0.90", "–", "1.0"))
    assert backends.notes[0] == "Means on a GPU, the rigid step on the CPU."
    assert [each.title for each in tables3(timed, [])[:2]] == [timing_table(timed, []).title, table.title]


def test_fewer_evaluations_of_slower_ways_are_said():
    fewer = [replace(row, poses=200) if row.method == "coarse_plain" else row for row in rows()]
    assert any(
        "1,000 evaluations of single poses (200 where a method has a quicker way)" in note
        for note in timing_table(fewer, []).notes
    )


def test_all_cores_have_a_table_of_backends_too_where_one_divides_its_work():
    threaded = Row("table3", "teen", "dense_onnx_spinning", "time_all_cores", "ms", 0.9, None, 1, 1_000, "laptop", "r")
    one, both = backends_tables([*rows(), threaded], "teen")
    assert one.headers == backends_tables(rows(), "teen")[0].headers and one.notes[0].startswith("Means on one core,")
    assert "ONNX, spinning" in both.headers[0] and both.notes[0].startswith("Means on all cores,")
    assert {line[0]: line[1:] for line in both.body}["Dense"] == ("–", "2.00", "0.90", "1.00", "0.50", "2.2")


def test_results_of_one_backend_have_no_table_of_backends():
    alone = [row for row in rows() if row.method in ("rig", "coarse")]
    assert backends_tables(alone, "teen") == [] and len(tables3(alone, [])) == 2


def test_the_best_evaluation_is_the_fastest_exact_one():
    assert best_row(rows(), "teen", "dense", "all_cores").method == "dense_fast"
    assert best_row(rows(), "teen", "coarse", "one_core").value == 6.0
    assert best_row(rows(), "teen", "refined", "one_core") is None


def test_in_the_committed_table_the_coarse_model_never_costs_more_than_the_refined_one_that_contains_it():
    rows = read_results(REFERENCE / "table3.csv")
    costs = {row.key: row.value for row in rows if not row.metric.startswith(("largest_difference", CHANGE))}
    pairs = [
        (key, ("table3", who, "refined" + parted(method)[1], metric))
        for key in costs
        for _, who, method, metric in (key,)
        if parted(method)[0] == "coarse"
    ]
    assert len(pairs) > 100 and [key for key, refined in pairs if costs[key] > costs[refined]] == []


def test_the_chart_has_what_has_error_time_and_size():
    figure, words = frontier_chart(rows(), rows(), "teen")
    assert (
        len(figure.axes) == 2
        and "Coarse: 4.00 ms, 1.00°" in words.alt
        and "Dense: 1.00 ms, 1.00°" in words.alt
        and "Dense: 5.00 MB" in words.alt
    )
    assert "The rig" not in words.alt
    assert frontier_chart(rows(), [], "teen") is None


def dot(method: str, ms: float, mb: float, degrees: float) -> list[Row]:
    """Return what the frontier needs of a method."""
    numbers = (("table3", "time_all_cores", "ms", ms), ("table3", "model_size", "MB", mb),
               ("table2", "normal_error_mean", "deg", degrees))  # fmt: skip
    facts = None, 1, 1_000, "laptop", "r"
    return [Row(table, "teen", method, metric, unit, value, *facts) for table, metric, unit, value in numbers]


def test_labels_of_near_dots_stand_on_either_side_of_them():
    near = dot("refined", 5.0, 50.0, 1.01)
    figure, _ = frontier_chart([*rows(), *near], [*rows(), *near], "teen")
    times, sizes = ({text.get_text(): text.xyann[1] for text in axes.texts} for axes in figure.axes)
    assert times["Coarse"] < 0 < times["Refined"] and times["Dense"] > 0
    assert sizes["Coarse"] < 0 < sizes["Dense"] and sizes["Refined"] > 0, "of the same size"


def test_labels_of_dots_stay_inside_their_panel():
    small = dot("regional", 0.5, 1.0, 0.3)
    figure, _ = frontier_chart([*rows(), *small], [*rows(), *small], "teen")
    figure.draw_without_rendering()
    for axes in figure.axes:
        room = axes.get_window_extent()
        label = next(text for text in axes.texts if text.get_text() == "Regional (ours)").get_window_extent()
        assert room.x0 < label.x0 and label.x1 < room.x1


@pytest.mark.parametrize(
    ("name", "label"),
    [
        ("rig", "The rig, compiled"),
        ("dense", "Dense"),
        ("dense_fast", "Dense, fast"),
        ("rigid_step_fast", "Rigid step alone, fast"),
    ],
)
def test_labels(name, label):
    assert label_of(name) == label
