"""All results of a run as one DataFrame: every table of it, checked; nothing heavy is loaded before."""

import dataclasses
import subprocess
import sys

import pandas
import pytest

import replicate
from replicate.base.exceptions import InputError
from replicate.base.paths import REFERENCE, ROOT
from replicate.report.results import COLUMNS, Row, read_results, write_results

ROW = Row("table2", "teen", "coarse", "vertex_error_mean", "mm", 0.1 + 0.2, None, 1, 1234, "laptop", "abc")
OTHER = dataclasses.replace(ROW, table="table1", metric="vertices", unit="count", sd=0.5, seeds=None, poses=None)


@pytest.fixture
def runs(tmp_path, monkeypatch):
    """The folder of all runs' results, with those of the profile laptop."""
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path))
    (tmp_path / "laptop").mkdir()
    write_results(tmp_path / "laptop" / "table2.csv", [ROW])
    write_results(tmp_path / "laptop" / "table1.csv", [OTHER])
    (tmp_path / "laptop" / "table2_curves.csv").write_text("character,method,step,loss,mm,degrees\n")
    (tmp_path / "laptop" / "figure07_teen.csv").write_text("segment,kind\n")
    return tmp_path


def test_a_run_is_one_table_of_all_its_numbers(runs):
    table = replicate.results("laptop")
    assert tuple(table.columns) == COLUMNS and table.index.tolist() == [0, 1]
    assert table["table"].tolist() == ["table1", "table2"] and table["value"].tolist() == [0.1 + 0.2] * 2
    assert table["seeds"].tolist() == [pandas.NA, 1] and table["poses"].tolist() == [pandas.NA, 1234]
    assert table["seeds"].dtype == table["poses"].dtype == "Int64" and table["sd"].dtype == "float64"
    assert table["sd"].isna().tolist() == [False, True]


def test_the_committed_results_hold_every_number_of_their_files():
    table = replicate.results()
    files = [REFERENCE / f"{name}.csv" for name in ("table1", "table2", "table3", "table4", "rig_report")]
    files += sorted([*REFERENCE.glob("bench_*.csv"), *REFERENCE.glob("figure??.csv")])
    rows = [row for file in files for row in read_results(file)]
    assert len(table) == len(rows) and table["value"].sum() == pytest.approx(sum(row.value for row in rows))
    assert {"table1", "table2", "table2_segments", "rig_report", "bench_lbs"} < set(table["table"])
    errors = table.query("table == 'table2' and metric == 'normal_error_mean' and character == 'teen'")
    by_method = errors.set_index("method")["value"]
    assert by_method["refined"] < by_method["coarse"] < by_method["neutral"]


def test_the_papers_own_numbers_are_published_ones():
    table = replicate.results("published")
    assert set(table["table"]) == {"table1", "table2", "table3", "table4"} and set(table["profile"]) == {"published"}
    (value,) = table.query("table == 'table2' and character == 'Hiccup' and method == 'refined' and unit == 'deg'")[
        "value"
    ]
    assert value == 0.9


@pytest.mark.parametrize(
    "run, sentence",
    [
        ("quick", "quick: there are no results yet; .*`make table2 PROFILE=quick` writes them"),
        ("paper", 'paper: there are no results yet; .*`make table2 PROFILE=paper`.*"published" are the paper\'s own'),
        ("bench", "bench: there are no results yet; `make bench-rig`"),
        (
            "latpop",
            "named 'latpop'; there can be reference, reference_paper_profile, reference_clips, reference_gpu, "
            "published, quick, laptop, paper, bench",
        ),
        ("../laptop", "no results named '../laptop'"),
    ],
)
def test_results_that_are_not_there_name_what_writes_them(runs, run, sentence):
    with pytest.raises(InputError, match=sentence):
        replicate.results(run)


def test_a_table_that_is_none_is_named_with_its_line(runs):
    (runs / "laptop" / "table2.csv").write_text(",".join(COLUMNS) + "\nt,c,m,e,furlong,1,,1,2,laptop,r\n")
    with pytest.raises(InputError, match=r"laptop/table2\.csv, line 2: unit: expected .*, got 'furlong'"):
        replicate.results("laptop")


def test_a_number_that_two_files_have_is_refused(runs):
    write_results(runs / "laptop" / "table2.csv", [ROW, OTHER])
    with pytest.raises(InputError, match=r"table2\.csv, line 2: found a second row for \('table1', .* another file"):
        replicate.results("laptop")


def test_importing_the_project_loads_nothing_heavy():
    program = """import sys, replicate, replicate.report.results
print({"pandas", "torch", "jax", "matplotlib"} & set(sys.modules))"""
    process = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert process.stdout.strip() == "set()"
