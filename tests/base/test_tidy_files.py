"""CSV files: what is written is read back to the last bit, and every cell that may not stand there is named."""

import csv
import math
import os
import struct

import numpy as np
import pandas
import pytest

from replicate.base.exceptions import InputError
from replicate.base.paths import RESULTS
from replicate.base.tables import Column, read_csv, write_csv

COLUMNS = (
    Column("name"),
    Column("unit", choices=("mm", "deg")),
    Column("error", "finite number"),
    Column("loss", "number", optional=True),
    Column("poses", "whole number", optional=True),
)
HEADER = "name,unit,error,loss,poses\n"
TABLES = sorted(RESULTS.glob("*/*.csv"))


def read(path) -> pandas.DataFrame:
    return read_csv(path, COLUMNS, ("name",), "there is no such file.")


def test_every_kind_of_cell_is_read_back_as_it_was_written(tmp_path):
    lines = [
        ('a "quoted", name', "mm", 0.1 + 0.2, None, 3),
        ("two\nlines", "deg", np.float32(0.1), math.inf, None),
        ("NA", "deg", -5e-324, 1e300, np.int64(7)),
    ]
    write_csv(tmp_path / "t.csv", COLUMNS, lines)
    frame = read(tmp_path / "t.csv")
    assert frame.dtypes.astype(str).tolist() == ["str", "str", "float64", "float64", "Int64"]
    assert frame["name"].tolist() == ['a "quoted", name', "two\nlines", "NA"]
    assert frame["error"].tolist() == [0.1 + 0.2, float(np.float32(0.1)), -5e-324]
    assert math.isnan(frame["loss"][0]) and frame["loss"].tolist()[1:] == [math.inf, 1e300]
    assert frame["poses"].tolist() == [3, pandas.NA, 7]


def test_a_file_that_has_changed_is_read_anew_and_nobody_changes_what_others_read(tmp_path):
    file = tmp_path / "t.csv"
    write_csv(file, COLUMNS, [("a", "mm", 1.5, None, 3)])
    frame = read(file)
    frame.loc[0, "error"] = 7.0
    assert read(file)["error"].tolist() == [1.5]
    before = file.stat()
    file.write_text(file.read_text().replace("1.5", "2.5"))  # in place, and as many bytes
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns + 1))
    assert read(file)["error"].tolist() == [2.5]
    file.unlink()
    with pytest.raises(InputError, match="there is no such file"):
        read(file)


def test_numbers_of_all_sizes_are_read_back_to_the_last_bit(tmp_path):
    bits = np.random.default_rng(0).integers(0, 2**63, 2000)
    numbers = [x for (x,) in struct.iter_unpack("d", bits.tobytes()) if math.isfinite(x)]
    write_csv(tmp_path / "t.csv", COLUMNS[2:3], ([x] for x in numbers))
    assert read_csv(tmp_path / "t.csv", COLUMNS[2:3], (), "")["error"].tolist() == numbers


@pytest.mark.parametrize("path", TABLES, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_a_committed_file_is_written_again_byte_for_byte(tmp_path, path):
    with open(path, encoding="utf-8", newline="") as file:
        header, *lines = csv.reader(file)
    columns = [_likely_column(name, cells) for name, *cells in zip(header, *lines, strict=True)]
    frame = read_csv(path, columns, (), "").astype(object)
    values = frame.where(frame.notna(), None)
    write_csv(tmp_path / path.name, columns, values.itertuples(index=False, name=None))
    assert (tmp_path / path.name).read_bytes() == path.read_bytes()


def _likely_column(name: str, cells: list[str]) -> Column:
    if all(cell.isdigit() for cell in cells if cell):
        return Column(name, "whole number", optional=True)
    try:
        [float(cell) for cell in cells if cell]
    except ValueError:
        return Column(name, optional=True)
    return Column(name, "finite number", optional=True)


@pytest.mark.parametrize(
    "text, sentence",
    [
        ("", "line 1: expected the header 'name,unit,error,loss,poses', got 'nothing'"),
        ("\n", "line 1: expected the header .*, got ''"),
        ("name,unit\n", "line 1: expected the header .*, got 'name,unit'"),
        (
            HEADER.replace("poses", "poses,more"),
            "line 1: expected the header .*, got 'name,unit,error,loss,poses,more'",
        ),
        (HEADER + "a,mm,1,,\nb,mm,1,\n", "line 3: expected 5 cells, got 4"),
        (HEADER + "a,mm,1,,,\n", "line 2: expected 5 cells, got 6"),
        (HEADER + "a,mm,1,,\nb,mm,1,,,,,,\n", "line 3: expected 5 cells, got 9"),
        (HEADER + "a,mm,1,,\nb" + "," * 99 + "\n", "line 3: expected 5 cells, got 100"),
        (HEADER + "a,mm,1,,\n\nb,mm,1,,\n", "line 3: expected 5 cells, got 0"),
        (HEADER + ",mm,1,,\n", "line 2: name: expected text, got ''"),
        (HEADER + "a,cm,1,,\n", "line 2: unit: expected mm or deg, got 'cm'"),
        (HEADER + "a,mm,,,\n", "line 2: error: expected a finite number, got ''"),
        (HEADER + "a,mm,nan,,\n", "error: expected a finite number, got 'nan'"),
        (HEADER + "a,mm,1e999,,\n", "error: expected a finite number, got '1e999'"),
        (HEADER + "a,mm,1_000,,\n", "error: expected a finite number, got '1_000'"),
        (HEADER + "a,mm,٣,,\n", "error: expected a finite number, got '٣'"),
        (HEADER + "a,mm,0x10,,\n", "error: expected a finite number, got '0x10'"),
        (HEADER + "a,mm,1,x,\n", "loss: expected a number, got 'x'"),
        (HEADER + "a,mm,1,,1.5\n", "poses: expected a whole number, got '1.5'"),
        (HEADER + "a,mm,1,,99999999999999999999\n", "poses: expected a whole number .*, got '99999999999999999999'"),
        (HEADER + "a,mm,1,,\na,mm,2,,\n", "line 3: expected one row for .'a',., got a second"),
        (
            HEADER + "a,mm,1,,1000000000000000000\n",
            "line 2: poses: expected a whole number of at most 18 digits, got '10+'",
        ),
        (HEADER + 'a,mm,1,,\n"b,mm,1,,\n', "line 3: expected comma-separated values .*unexpected end"),
        (HEADER + '"a\nb",mm,1,,\n"c"d,mm,1,,\n', "line 4: expected comma-separated values"),
        (HEADER + '"a,mm,1,,\n', "expected comma-separated values .*unexpected end"),
        (HEADER + "x" * 200_000 + ",mm,1,,\n", "expected comma-separated values .*field larger"),
    ],
)
def test_what_may_not_stand_there_is_named_with_its_line(tmp_path, text, sentence):
    path = tmp_path / "t.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=sentence) as error:
        read(path)
    assert str(error.value).startswith(str(path)) and len(str(error.value)) < len(str(path)) + 250


def test_a_cell_without_end_is_not_repeated_whole(tmp_path):
    path = tmp_path / "t.csv"
    for text in (HEADER + f"a,mm,{'9' * 5000}x,,\n", "x" * 100_000):
        path.write_text(text)
        with pytest.raises(InputError) as error:
            read(path)
        assert len(str(error.value)) < len(str(path)) + 400


def test_a_file_that_is_missing_or_cannot_be_read_is_named(tmp_path):
    with pytest.raises(InputError, match=r"t\.csv: there is no such file\."):
        read(tmp_path / "t.csv")
    with pytest.raises(InputError, match="can't be read"):
        read(tmp_path)
    (tmp_path / "t.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="expected comma-separated values"):
        read(tmp_path / "t.csv")


def test_a_file_with_a_header_alone_is_an_empty_table(tmp_path):
    write_csv(tmp_path / "t.csv", COLUMNS, [])
    assert (tmp_path / "t.csv").read_text() == HEADER
    frame = read(tmp_path / "t.csv")
    assert len(frame) == 0 and frame["error"].dtype == "float64"


@pytest.mark.parametrize(
    "line, sentence",
    [
        (("b", "mm", math.nan, None, None), "line 3: error: expected a finite number, got 'nan'"),
        (("b", "mm", 1.0, None, 1.5), "poses: expected a whole number, got '1.5'"),
        (("a", "mm", 1.0, None, None), "line 3: expected one row for .*, got a second"),
    ],
)
def test_what_could_not_be_read_is_not_written(tmp_path, line, sentence):
    path = tmp_path / "t.csv"
    path.write_text("as it was")
    with pytest.raises(InputError, match=sentence):
        write_csv(path, COLUMNS, [("a", "mm", 1.0, None, None), line], ("name",))
    assert path.read_text() == "as it was" and list(tmp_path.iterdir()) == [path]


def test_a_write_that_fails_leaves_nothing_behind(tmp_path):
    (tmp_path / "t.csv").mkdir()
    with pytest.raises(OSError):
        write_csv(tmp_path / "t.csv", COLUMNS, [])
    assert list(tmp_path.iterdir()) == [tmp_path / "t.csv"]
