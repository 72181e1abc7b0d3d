"""Trainings compared: which ones, how they are shown, and what a typing mistake gets."""

from dataclasses import asdict

from replicate.benchmarks import bench_training as training
from replicate.benchmarks.training_table import axis_text, draws_text, trainings_table
from replicate.config import resolve
from replicate.report.results import Row


def test_every_method_is_tried_with_the_same_changes():
    by_method = {method: [v for v in training.variants(700) if v.method == method] for method in training.SECTIONS}
    schedules = {}
    for method, section in training.SECTIONS.items():
        schedules[method] = [
            getattr(resolve("tiny", "laptop", v.overrides), section).training for v in by_method[method]
        ]
        assert [s.peak_rate for s in schedules[method]][: len(training.RATES)] == list(training.RATES)
        assert {s.steps for s in schedules[method]} == {700}
    assert schedules["coarse"] == schedules["refined"] == schedules["dense"]


def test_each_change_is_of_one_thing():
    usual = resolve("tiny", "laptop", {"coarse": {"training": {"steps": 700}}})
    for variant in training.variants(700):
        if variant.method == "coarse":
            changed = resolve("tiny", "laptop", variant.overrides).coarse.training
            differing = [
                name for name, value in asdict(changed).items() if value != getattr(usual.coarse.training, name)
            ]
            assert len(differing) == (0 if variant.change == "0.005, 700 steps" else 1), variant.change


def test_a_training_is_one_line_of_the_table():
    def row(method, metric, unit, value):
        return Row("bench_training", "teen", method, metric, unit, value, None, 1, 64, "laptop", "bench-training")

    rows = [
        row("dense", "validation_vertex_error[0.005, 10 steps]", "mm", 0.5),
        row("coarse", "normal_error_over_floor[uniform draws]", "ratio", 1.25),
        row("coarse", "validation_normal_error[uniform draws]", "deg", 2.0),
        row("coarse", "validation_vertex_error[uniform draws]", "mm", 0.25),
    ]
    table = trainings_table(rows)
    assert table.body == (
        ("coarse", "uniform draws", "0.25", "2.00", "1.25"),
        None,
        ("dense", "0.005, 10 steps", "0.50", "", ""),
    )


def test_a_training_that_there_is_not_is_named(capsys):
    assert training.main(["--only", "sparse"]) == 2
    assert "'sparse'" in capsys.readouterr().err


def test_rare_intervals_get_as_many_draws_as_common_ones():
    assert draws_text([2, 90, 0, 3, 5]) == "2 of 4 intervals hold 5.0 % of the samples and get 50 % of the draws"


def test_the_controls_behind_the_intervals_are_named_strongest_first():
    facts = (None, 1, 9, "laptop", "bench-training")
    rows = [
        Row("bench_training", "teen", "samples", f"interval_correlation[{name}]", "ratio", value, *facts)
        for name, value in (("jaw_open", 0.5), ("squash", -0.7))
    ]
    assert axis_text(rows).endswith(": squash -0.70, jaw_open +0.50")
    assert trainings_table(rows).body == ()
