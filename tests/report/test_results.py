"""Results on disk: tidy, exact, sorted, and refused with one sentence when they are no such thing."""

import dataclasses

import pytest

from replicate.base.exceptions import InputError
from replicate.base.paths import ROOT
from replicate.report.results import (
    COLUMNS,
    Row,
    find,
    over_seeds,
    read_curves,
    read_results,
    read_seeds,
    seeds_note,
    write_curves,
    write_results,
    write_seeds,
)

ROW = Row("table2", "teen", "coarse", "vertex_error_mean", "mm", 0.1 + 0.2, None, 1, 1234, "quick", "abc")
PAPER = ROOT / "results" / "paper"


def row_with(**values) -> Row:
    return dataclasses.replace(ROW, **values)


def test_a_table_is_read_back_to_the_last_bit(tmp_path):
    rows = [ROW, row_with(method="dense", value=1 / 3, sd=2e-17, seeds=None, poses=None, run='odd, "quoted" run')]
    write_results(tmp_path / "t.csv", rows)
    assert read_results(tmp_path / "t.csv") == rows


def test_the_order_of_rows_does_not_change_the_file(tmp_path):
    rows = [
        ROW,
        row_with(method="dense"),
        row_with(character="dragon"),
        row_with(metric="normal_error_mean", unit="deg"),
    ]
    write_results(tmp_path / "a.csv", rows)
    write_results(tmp_path / "b.csv", reversed(rows))
    text = (tmp_path / "a.csv").read_bytes()
    assert text == (tmp_path / "b.csv").read_bytes()
    assert b"\r" not in text and text.splitlines()[0].decode() == ",".join(COLUMNS)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.csv", "b.csv"]


def test_the_bytes_of_a_file_are_these(tmp_path):
    odd = row_with(method="a b", metric="m[16, refined]", value=1e-7, sd=2.0, seeds=3, poses=None, run='"odd", é')
    write_results(tmp_path / "t.csv", [ROW, odd])
    assert (tmp_path / "t.csv").read_bytes().decode() == (
        "table,character,method,metric,unit,value,sd,seeds,poses,profile,run\n"
        'table2,teen,a b,"m[16, refined]",mm,1e-07,2.0,3,,quick,"""odd"", é"\n'
        "table2,teen,coarse,vertex_error_mean,mm,0.30000000000000004,,1,1234,quick,abc\n"
    )


@pytest.mark.parametrize(
    "file", sorted((ROOT / "results").glob("*/[bt]*.csv")), ids=lambda file: f"{file.parent.name}/{file.name}"
)
def test_a_committed_table_is_written_again_byte_for_byte(tmp_path, file):
    if file.name == "table2_curves.csv":
        write_curves(tmp_path / file.name, read_curves(file))
    elif file.name == "table2_seeds.csv":
        write_seeds(tmp_path / file.name, read_seeds(file))
    else:
        write_results(tmp_path / file.name, read_results(file))
    assert (tmp_path / file.name).read_bytes() == file.read_bytes()


@pytest.mark.parametrize(
    "rows, sentence",
    [
        ([row_with(value=float("nan"))], "value: expected a finite number, got 'nan'"),
        ([row_with(sd=float("inf"))], "sd: expected a finite number, got 'inf'"),
        ([row_with(unit="furlong")], "unit: expected mm, deg, ms, s, J, MB, count or ratio, got 'furlong'"),
        ([row_with(method="")], "method: expected text, got ''"),
        ([ROW, row_with(value=2.0)], "expected one row for .*, got a second"),
    ],
)
def test_a_bad_row_is_not_written(tmp_path, rows, sentence):
    with pytest.raises(InputError, match=sentence):
        write_results(tmp_path / "t.csv", rows)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "text, sentence",
    [
        ("", "line 1: expected the header .*, got 'nothing'"),
        ("a,b\n1,2\n", "line 1: expected the header .*, got 'a,b'"),
        (",".join(COLUMNS) + "\ntable2,teen\n", "line 2: expected 11 cells, got 2"),
        (",".join(COLUMNS) + "\nt,c,m,e,mm,abc,,1,2,quick,r\n", "line 2: value: expected a finite number, got 'abc'"),
        (",".join(COLUMNS) + "\nt,c,m,e,mm,,,1,2,quick,r\n", "line 2: value: expected a finite number, got ''"),
        (",".join(COLUMNS) + "\nt,c,m,e,mm,inf,,1,2,quick,r\n", "line 2: value: expected a finite number, got 'inf'"),
        (",".join(COLUMNS) + "\nt,c,m,e,mm,1,nan,1,2,quick,r\n", "line 2: sd: expected a finite number, got 'nan'"),
        (",".join(COLUMNS) + "\nt,c,m,e,m,1,,1,2,quick,r\n", "line 2: unit: expected mm, deg.*, got 'm'"),
        (",".join(COLUMNS) + "\nt,c,m,e,mm,1,,1.5,2,quick,r\n", "seeds: expected a whole number, got '1.5'"),
        (",".join(COLUMNS) + "\n" + "t,c,m,e,mm,1,,1,2,quick,r\n" * 2, "line 3: expected one row for .*, got a second"),
    ],
)
def test_a_file_that_is_no_such_table_is_named_with_its_line(tmp_path, text, sentence):
    path = tmp_path / "table2.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=sentence) as error:
        read_results(path)
    assert str(error.value).startswith(str(path))


def test_a_missing_or_binary_file_is_named(tmp_path):
    with pytest.raises(InputError, match="there is no such results file"):
        read_results(tmp_path / "table9.csv")
    (tmp_path / "t.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="expected comma-separated values"):
        read_results(tmp_path / "t.csv")


def test_the_papers_tables_are_the_papers():
    tables = {number: read_results(PAPER / f"table{number}.csv") for number in (1, 2, 3, 4)}
    assert {number: len(rows) for number, rows in tables.items()} == {1: 28, 2: 48, 3: 39, 4: 16}
    assert find(tables[1], "table1", "Hiccup", "model", "vertices").value == 12510
    assert find(tables[2], "table2", "Hiccup", "refined", "normal_error_mean").value == 0.9
    assert find(tables[2], "table2", "Ray", "dense", "vertex_error_mean").value == 5.0
    assert find(tables[4], "table4", "Toothless", "dense", "vertex_error_mean").value == 11.19
    doubtful = sorted((r.character, r.method, r.metric) for r in tables[3] if "doubtful" in r.run)
    assert doubtful == [
        ("Hiccup", "coarse", "time_consumer_cpu"),
        ("Hiccup", "coarse", "time_consumer_gpu"),
        ("Toothless", "dense", "time_consumer_gpu"),
    ]


def test_the_papers_headline_speed_ups_follow_from_table_3():
    rows = read_results(PAPER / "table3.csv")

    def ratio(character):
        rig = find(rows, "table3", character, "rig", "time_cpu_engine").value
        return rig / find(rows, "table3", character, "refined", "time_high_end_cpu").value

    assert round(ratio("Toothless")) == 5 and round(ratio("Valka")) == 17


def test_seeds_become_one_row_of_their_mean_and_standard_deviation():
    runs = [[row_with(value=value, run=run, poses=poses)] for value, run, poses in ((1.0, "a", 60), (3.0, "b", 50))]
    runs[0].append(row_with(method="refined", metric="normal_error_mean[face_4]", value=5.0))
    mean, alone = over_seeds(runs)
    assert (mean.value, mean.seeds, mean.poses) == (2.0, 2, 50) and mean.sd == pytest.approx(2**0.5)
    assert (alone.value, alone.sd, alone.seeds) == (5.0, None, 1)
    assert mean.run == alone.run and mean.run not in ("a", "b", "abc")
    assert over_seeds(runs[:1]) == runs[0]


@pytest.mark.parametrize(
    ("counts", "words"),
    [
        ((1, 1), "one seed"),
        ((2, 2), "2 seeds, ± their standard deviation"),
        ((3, 2), "2 to 3 seeds, ± their standard deviation"),
        ((1, 3), "1 to 3 seeds, ± their standard deviation"),
        ((None, None), ""),
    ],
)
def test_a_note_says_on_how_many_seeds_each_character_stands(counts, words):
    rows = [row_with(character=name, seeds=count) for name, count in zip(("teen", "dragon"), counts, strict=True)]
    assert seeds_note([*rows, row_with(metric="texels_per_vertex", seeds=None)]) == words
