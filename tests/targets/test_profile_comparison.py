"""Table 2 with two profiles, and two splits, side by side: characters and methods that are there, ratios of both."""

from dataclasses import replace

from replicate.base import paths
from replicate.report.results import Row, write_results
from replicate.targets.table2.rows import clips_rows, layout_tables, paper_profile_rows, profile_tables, split_tables


def rows(profile: str, scale: float, *characters: str) -> list[Row]:
    errors = {"coarse": 4.0, "refined": 2.0, "dense": 1.0}
    units = {"vertex_error_mean": ("mm", 1), "normal_error_mean": ("deg", 10), "training": ("s", 100)}
    return [
        Row("table2", character, method, metric, unit, scale * factor * error, None, 1, 9, profile, "r")
        for character in characters
        for method, error in errors.items()
        for metric, (unit, factor) in units.items()
    ]


def test_each_method_that_both_profiles_have_stands_beside_itself():
    longer = [row for row in rows("paper", 0.5, "teen", "toon") if row.method != "refined"]
    (table,) = profile_tables(rows("laptop", 1.0, "teen", "woman"), longer)
    assert table.title.endswith("teen") and table.headers[1][1:3] == ("laptop", "paper")
    lines = {line[0]: line[1:] for line in table.body if line}
    assert lines == {
        "Coarse": ("4.00", "2.00", "40.00", "20.00", "400", "200"),
        "Dense": ("1.00", "0.50", "10.00", "5.00", "100", "50"),
    }


def test_ratios_are_of_each_profile_by_itself():
    scales = {"refined": 4.0}
    longer = [replace(row, value=scales.get(row.method, 1) * row.value) for row in rows("paper", 0.5, "teen")]
    (table,) = profile_tables(rows("laptop", 1.0, "teen"), longer)
    lines = {line[0]: line[1:5] for line in table.body if line}
    assert lines["Refined / Coarse"] == ("0.50", "2.00", "0.50", "2.00")


def test_committed_results_have_committed_ones_beside_them_and_yours_have_yours(tmp_path, monkeypatch):
    monkeypatch.setattr(paths, "REFERENCE", tmp_path / "reference")
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / "runs"))
    assert paper_profile_rows("reference") == paper_profile_rows("laptop") == []
    for folder, name in ((paths.committed_folders()[paths.PAPER_PROFILE], "teen"), (tmp_path / "runs/paper", "woman")):
        folder.mkdir(parents=True)
        write_results(folder / "table2.csv", rows("paper", 1.0, name))
    assert {row.character for row in paper_profile_rows("reference")} == {"teen"}
    assert {row.character for row in paper_profile_rows("laptop")} == {"woman"}


def test_two_splits_stand_side_by_side_for_committed_results_alone(tmp_path, monkeypatch):
    monkeypatch.setattr(paths, "REFERENCE", tmp_path / "reference")
    assert clips_rows("reference") == []
    folder = paths.committed_folders()[paths.WHOLE_CLIPS]
    folder.mkdir(parents=True)
    write_results(folder / "table2.csv", rows("laptop", 2.0, "teen"))
    (table,) = split_tables(rows("laptop", 1.0, "teen", "woman"), clips_rows("reference"))
    assert table.title == "Two splits: teen" and table.headers[1][1:3] == ("frames", "clips")
    assert table.body[0] == ("Coarse", "4.00", "8.00", "40.00", "80.00", "400", "800")
    assert clips_rows("laptop") == []


def test_two_layouts_of_charts_stand_side_by_side_and_rungs_of_the_ladder_do_not():
    own = rows("laptop", 1.0, "teen", "woman")
    (table,) = layout_tables([*own, *rows("laptop", 3.0, "teen@one_face", "teen@4", "toon@one_face")])
    assert table.title == "Two layouts of charts: teen"
    assert table.headers[1][1:3] == ("its own charts", "one face")
    assert table.body[0] == ("Coarse", "4.00", "12.00", "40.00", "120.00", "400", "1,200")
    assert layout_tables(own) == []
