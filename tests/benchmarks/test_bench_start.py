"""What a method needs until its first pose: which processes are started, and the table."""

from replicate.benchmarks.bench_start import TABLE, start_table
from replicate.report.results import Row


def test_what_a_method_needs_until_its_first_pose_has_a_table_of_its_own():
    numbers = (
        ("dense", "first_pose", "s", 2.5),
        ("dense", "peak_memory", "MB", 300.0),
        ("dense", "model_size", "MB", 4.0),
    )
    numbers += (("dense_onnx", "first_pose", "s", 0.5),)
    rows = [Row(TABLE, "teen", *number, None, 1, 2, "bench", "teen") for number in numbers]
    table = start_table(rows, "teen")
    assert [line[:2] for line in table.body] == [("Dense", "the suite's"), ("Dense", "ONNX Runtime")]
    assert table.body[0][3] == "2.5" and table.body[1][3] == "0.5"
    assert table.body[0][2] == table.body[1][2] != "–", "both ways evaluate the same model"
    assert table.body[1][4] == "–" and table.body[1][2] != "–"


def test_a_way_that_keeps_its_code_has_a_row_for_the_processes_that_find_it():
    numbers = (("first_pose", "s", 9.0), ("first_pose_kept", "s", 1.2), ("peak_memory_kept", "MB", 500.0))
    rows = [Row(TABLE, "teen", "dense_fast", *number, None, 1, 2, "bench", "teen") for number in numbers]
    first, later = start_table(rows, "teen").body
    assert first[:2] == ("Dense", "fast") and first[3:] == ("9.0", "–")
    assert later[:2] == ("Dense", "fast, code kept") and later[3:] == ("1.2", "500.00")
