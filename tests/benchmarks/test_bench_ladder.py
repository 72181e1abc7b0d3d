"""The ladder: what is trained on each rung, how its tables and its figure read, and what it refuses."""

from dataclasses import replace

import pytest

from replicate.benchmarks import bench_ladder
from replicate.benchmarks.bench_ladder import TABLE, ladder_figure, ladder_tables, rungs_of
from replicate.benchmarks.common import bench_folder
from replicate.config import resolve
from replicate.methods.method_registry import sections
from replicate.report.results import Row, read_results, write_results

ERRORS = {"coarse": 4.0, "refined": 2.0, "dense": 1.0, "lbs32": 5.0, "regional": 0.5, "linear": 3.0, "neutral": 20.0}


def rows_of(rung: str, scale: float = 1.0) -> list[Row]:
    facts = (None, 1, 100 if rung == "1" else 200, "laptop", "bench-ladder")
    return [
        Row(TABLE, f"teen@{rung}", method, metric, unit, scale * error * factor, *facts)
        for method, error in ERRORS.items()
        for metric, unit, factor in (("vertex_error_mean", "mm", 1.0), ("normal_error_mean", "deg", 10.0))
    ]


def test_only_the_length_of_trainings_differs_from_the_profile():
    own = sections("laptop")
    usual, short = (
        resolve("teen@3", "laptop", sections=own),
        bench_ladder.rung_config("teen", "3", "laptop", bench_ladder.PART),
    )
    for name in bench_ladder.TRAINED:
        section, cut = getattr(usual, name), getattr(short, name)
        assert cut.training.steps == section.training.steps // bench_ladder.PART > 1_000
    steps = {name: {"training": {"steps": getattr(usual, name).training.steps}} for name in bench_ladder.TRAINED}
    assert (
        bench_ladder.rung_config("teen", "3", "laptop", 1) == resolve("teen@3", "laptop", steps, sections=own) == usual
    )


def test_held_out_clips_are_those_of_the_whole_rig_augmented_or_not():
    frames, clips, raw = (bench_ladder.rung_config("teen", rung, "laptop", 5) for rung in ("5", "clips", "raw"))
    assert (frames.character, clips.character, raw.character) == ("teen@5", "teen", "teen")
    assert (frames.samples.split, clips.samples.split, raw.samples.split) == ("frames", "clips", "clips")
    assert raw.samples.low == raw.samples.high == 1.0 and clips.samples.high > 1.0
    assert clips.coarse == raw.coarse and clips.regional == raw.regional == frames.regional


def test_tables_go_up_the_ladder_and_divide_what_claims_compare():
    rows = [*rows_of("uniform", 4.0), *rows_of("5", 2.0), *rows_of("1")]
    assert rungs_of(rows, "teen") == ["1", "5", "uniform"] and rungs_of(rows, "woman") == []
    errors, ratios = ladder_tables(rows, "teen")
    assert [name.partition(" ")[0] for name in errors.headers[0]] == ["", "@1", "@5", "uniform"]
    refined = [line for line in errors.body if line and line[0] == "Refined"]
    assert refined == [("Refined", "2.00", "4.00", "8.00"), ("Refined", "20.00", "40.00", "80.00")]
    assert "100 to 200 test poses" in errors.notes[0]
    lines = {line[0]: line[1:] for line in ratios.body if line}
    assert lines["C1: refined over coarse"] == ("0.50",) * 3 and lines["C2: refined over dense"] == ("2.00",) * 3
    assert lines["ours over refined"] == ("0.25",) * 3 and lines["ours over dense"] == ("0.50",) * 3


def test_a_ratio_without_one_of_its_numbers_is_a_dash():
    rows = [*rows_of("1"), *(row for row in rows_of("2") if row.method != "dense")]
    lines = {line[0]: line[1:] for line in ladder_tables(rows, "teen")[1].body if line}
    assert lines["ours over dense"] == ("0.50", "–") and lines["ours over refined"] == ("0.25", "0.25")


def test_the_figure_joins_the_steps_and_sets_uniform_poses_apart():
    rows = [*rows_of("1"), *rows_of("2", 2.0), *rows_of("uniform", 4.0), *rows_of("clips", 5.0)]
    figure, words = ladder_figure(rows, "teen")
    distance, normals = figure.axes
    joined = [line for line in distance.get_lines() if line.get_linestyle() != "None"]
    assert len(joined) == len(ERRORS) - 1  # the neutral pose is in the table alone
    assert joined[0].get_ydata() == pytest.approx([4.0, 8.0]) and joined[0].get_xdata() == pytest.approx([0, 1])
    alone = [tuple(line.get_xdata()) for line in distance.get_lines() if line.get_linestyle() == "None"]
    assert alone == [(2.4, 3.4)] * (len(ERRORS) - 1) and normals.get_yscale() == "log"
    assert "Refined, degrees: @1 20.00, @2 40.00, uniform 80.00, clips 100.00" in words.alt


def test_rungs_are_measured_in_turn_and_each_is_kept_before_the_next(capsys, monkeypatch, tmp_path):
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path))
    file, seen = tmp_path / "bench" / "bench_ladder.csv", []

    def measure(head, rung, profile, part, methods):
        assert tuple(methods) == bench_ladder.METHODS
        seen.append((head, rung, profile, part, len(read_results(file)) if file.is_file() else 0))
        return rows_of(rung)

    monkeypatch.setattr(bench_ladder, "measure", measure)
    assert (
        bench_ladder.main(["--characters", "teen", "--rungs", "1, uniform", "--part", "7", "--profile", "quick"]) == 0
    )
    assert seen == [("teen", "1", "quick", 7, 0), ("teen", "uniform", "quick", 7, 2 * len(ERRORS))]
    assert (tmp_path / "bench" / "bench_ladder_teen.png").is_file()
    assert "The ladder of teen: ratios" in capsys.readouterr().out
    assert bench_ladder.main(["--characters", "teen", "--rungs", "3"]) == 0
    printed = capsys.readouterr().out
    assert "@1 targets" in printed and "@3 + turns" in printed and "uniform poses" in printed, "all that there are"


def test_a_part_of_the_methods_joins_the_rows_of_the_others(monkeypatch, tmp_path):
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path))
    write_results(bench_folder() / "bench_ladder.csv", rows_of("1"))

    def measure(head, rung, profile, part, methods):
        return [replace(row, value=row.value / 2) for row in rows_of(rung) if row.method in methods]

    monkeypatch.setattr(bench_ladder, "measure", measure)
    assert bench_ladder.main(["--rungs", "1", "--only", "refined|dense"]) == 0
    then = {row.key: row.value for row in read_results(tmp_path / "bench" / "bench_ladder.csv")}
    before = {row.key: (row.value, row.method) for row in rows_of("1")}
    assert then.keys() == before.keys()
    for key, (value, method) in before.items():
        assert then[key] == (value / 2 if method in ("refined", "dense") else value)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--rungs", "7"], "rungs: expected some of 1, 2, 3, 4, 5, 6, uniform, one_face, clips, raw, got '7'"),
        (["--rungs", ""], "raw, got ''"),
        (["--characters", "teen@2"], "character 'teen@2' is one rig of a ladder: name its head, 'teen'"),
        (["--part", "0"], "part: expected a whole number of at least 1, got 0"),
        (["--only", "perceptron"], "only: no training's name has 'perceptron' in it; there are coarse; refined; dense"),
    ],
)
def test_what_it_can_not_measure_is_refused(words, said, capsys):
    assert bench_ladder.main(words) == 2 and said in capsys.readouterr().err
