"""Our SSDR beside its peer: what is fitted, what is kept of it, and how it is shown."""

import argparse
import re
from pathlib import Path

import pytest

from replicate.benchmarks import bench_lbs as bench
from replicate.report.results import Row, read_results


def fit_facts(rmse: float, course: list[float]) -> dict:
    errors = {"rmse": rmse, "mean": rmse / 2, "normal": 2.0, "max": 9.0}
    return errors | {"seconds": [float(k) for k in range(len(course))], "rmse_course": course, "peak_mb": 100.0}


def append_fit(file: Path, method: str, seed: int, rmse: float, course: list[float], **more: float) -> list[Row]:
    """Put a fit of teen's 16 bones into the file; Dem Bones came to 1 mm. Return all rows."""
    facts = fit_facts(rmse, course) | more
    bench._keep(file, bench.rows_of("teen", method, 16, seed, "rig-1", facts, 1.0))
    return read_results(file)


def options_of(training: int = 1_000, test: int = 200) -> argparse.Namespace:
    return argparse.Namespace(bones=[16], methods=["ssdr", "dem_bones"], training=training, test=test)


def lines(rows: list[Row]) -> dict[str, tuple[str, ...]]:
    return {line[0]: line[1:] for line in bench.lbs_table(rows, "teen").body if line}


@pytest.fixture
def both(tmp_path) -> Path:
    """A file with a fit of ours and one of the peer for each of two seeds."""
    file = tmp_path / "bench_lbs.csv"
    for seed, ours in ((0, 0.9), (1, 0.8)):
        append_fit(file, "dem_bones", seed, 1.0, [3.0, 2.0, 1.0])
        append_fit(file, "ssdr", seed, ours, [3.0, 1.0, 0.5])
    return file


def test_what_a_file_lacks_is_fitted_the_peer_first(tmp_path):
    file, options = tmp_path / "bench_lbs.csv", options_of()
    assert bench._missing(file, "teen", "rig-1", 0, options) == [(16, "dem_bones"), (16, "ssdr")]
    append_fit(file, "dem_bones", 0, 1.0, [3.0, 2.0, 1.0])
    assert bench._missing(file, "teen", "rig-1", 0, options) == [(16, "ssdr")]
    assert bench._peer_error(file, "teen", "rig-1", 16, 0) == 1 and bench._peer_error(file, "teen", "rig-2", 16, 0) == 0
    append_fit(file, "ssdr", 0, 0.9, [3.0, 1.0, 0.5])
    assert bench._missing(file, "teen", "rig-1", 0, options) == []
    assert bench._missing(file, "teen", "rig-2", 0, options), "another rig's numbers don't count"
    bench._keep(file, bench.rows_of("teen", "ssdr", 16, 0, "rig-2", fit_facts(0.5, [1.0]), 0.0))
    assert {row.run for row in read_results(file)} == {"rig-2"}


def test_numbers_of_other_counts_of_poses_stay_apart_and_are_fitted_anew(both):
    few = (100, 200)
    assert bench._missing(both, "teen", "rig-1", 0, options_of()) == []
    assert bench._missing(both, "teen", "rig-1", 0, options_of(training=100)) == [(16, "dem_bones"), (16, "ssdr")]
    assert bench._missing(both, "teen", "rig-1", 0, options_of(test=50))
    usual = bench.lbs_table(read_results(both), "teen")
    for method, rmse in (("dem_bones", 4.0), ("ssdr", 2.0)):
        facts = fit_facts(rmse, [9.0, rmse])
        bench._keep(both, bench.rows_of("teen", method, 16, 0, "rig-1", facts, 4.0, few))
    rows = read_results(both)
    assert bench._missing(both, "teen", "rig-1", 0, options_of(training=100)) == []
    assert bench._peer_error(both, "teen", "rig-1", 16, 0) == 1
    assert bench._peer_error(both, "teen", "rig-1", 16, 0, few) == 4
    assert bench.lbs_table(rows, "teen") == usual
    assert bench.lbs_table(rows, "teen", columns=("rmse", "time")).headers == (("", "RMSE, mm", "time, s"),)
    assert bench.lbs_table(rows, "teen", few).body[0][:2] == ("ours, 16 bones", "2.00")


@pytest.mark.parametrize("words", [("--bones", "16", "0"), ("--bones", "-1"), ("--seeds", "0", "-1")])
def test_numbers_of_bones_and_seeds_that_there_are_not_end_in_a_sentence(words, capsys):
    assert bench.main(["--characters", "tiny", *words]) == 2
    message = rf"{words[0][2:]}: expected a whole number of at least [01], got {words[-1]}\n"
    assert re.search(message, capsys.readouterr().err)


def test_the_time_to_equal_error_ends_where_the_peers_error_is_reached(both):
    value = {(row.method, row.metric): row.value for row in read_results(both)}
    assert value["ssdr", "time_to_dem_bones_error[16, seed 0]"] == 1000
    assert value["dem_bones", "time_to_dem_bones_error[16, seed 0]"] == 2000


def test_a_line_has_means_over_seeds_and_ratios_have_the_spread_of_theirs(both):
    rows = read_results(both)
    table = lines(rows)
    assert list(table) == ["ours, 16 bones", "Dem Bones, 16 bones", "ours / Dem Bones, 16 bones"]
    assert table["ours / Dem Bones, 16 bones"][0] == "0.85 ± 0.07" and table["ours, 16 bones"][0] == "0.85"
    (note,) = bench.lbs_table(rows, "teen").notes
    assert "means over 2 seeds" in note and "brackets" not in note and "own start" not in note


def test_a_line_of_fewer_seeds_and_a_number_of_fewer_than_its_line_say_so(both):
    rows = append_fit(both, "dem_bones_default", 1, 2.0, [3.0, 2.0])
    assert "Dem Bones, as it comes, 16 bones (1 of 2 seeds)" in lines(rows) and "Dem Bones, 16 bones" in lines(rows)
    assert "brackets" not in bench.lbs_table(rows, "teen").notes[0]
    append_fit(both, "ssdr_sparse", 0, 1.0, [3.0, 1.0])
    rows = append_fit(both, "ssdr_sparse", 1, 1.0, [3.0, 2.0])
    sparse = lines(rows)["ours, sparse from the start, 16 bones"]
    assert "1.0 (1)" in sparse, "only one seed came to Dem Bones' error"
    assert "brackets" in bench.lbs_table(rows, "teen").notes[0]
    partial = [r for r in rows if not (r.method == "dem_bones" and "seed 0" in r.metric)]
    assert "ours / Dem Bones, 16 bones (1 of 2 seeds)" in lines(partial)


def test_a_peer_that_got_our_clusters_is_told(both):
    rows = append_fit(both, "dem_bones", 0, 1.0, [3.0, 2.0, 1.0], bones_of_own_start=3)
    assert "(3 of 16)" in bench.lbs_table(rows, "teen").notes[0]


def test_without_the_peer_a_sentence_says_how_to_get_it(capsys, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "py_dem_bones._py_dem_bones", None)
    assert bench.main(["--characters", "tiny"]) == 2
    assert "pip install py-dem-bones" in capsys.readouterr().err
