"""The command line of benchmarks that measure methods: which methods, and whose numbers."""

from functools import partial

import pytest

from replicate.benchmarks import common
from replicate.report.results import Row
from replicate.report.tables import Table

STEPS = 7


def run_bench(monkeypatch, *words):
    seen = []
    monkeypatch.setattr(common, "publish", lambda name, rows, tables, command_line: seen.append(command_line))

    def measure(config, methods):
        seen.append((config.character, config.coarse.training.steps, config.regional.training.steps, methods))
        return [Row("bench_crowd", config.character, "linear", "steps", "count", 1.0, None, 1, 1, "bench", "teen")]

    def table(rows, character):
        return Table(character, (("",),), ())

    parser = common.make_parser("bench_crowd", "Time.", profile="whose trainings are timed")
    common.add_methods(parser, "table3")
    code = common.answer(parser, partial(common.bench_methods, "bench_crowd", measure, table), list(words))
    return code, seen


def test_a_file_of_numbers_overrides_the_profile_of_every_character(tmp_path, monkeypatch):
    file = tmp_path / "few steps.toml"
    file.write_text(f"[coarse.training]\nsteps = {STEPS}\n[regional.training]\nsteps = {STEPS}\n")
    words = ("--characters", "teen,toon", "--methods", "regional", "--config", str(file))
    code, seen = run_bench(monkeypatch, *words)
    assert code == 0
    assert seen == [
        ("teen", STEPS, STEPS, ["regional"]),
        list(words),
        ("toon", STEPS, STEPS, ["regional"]),
        list(words),
    ]


def test_without_a_file_the_profile_counts(monkeypatch):
    code, ((_, coarse, regional, _), _) = run_bench(monkeypatch, "--profile", "quick")
    assert code == 0 and coarse != STEPS and regional != STEPS


@pytest.mark.parametrize(
    ("content", "complaint"), [("[coarse]\nstep = 1\n", "step"), ("character = 'toon'\n", "CHARACTERS=")]
)
def test_a_bad_file_of_numbers_ends_before_anything_is_measured(content, complaint, tmp_path, monkeypatch, capsys):
    file = tmp_path / "bad.toml"
    file.write_text(content)
    code, seen = run_bench(monkeypatch, "--config", str(file))
    assert code == 2 and seen == []
    assert complaint in capsys.readouterr().err


def test_a_file_that_is_not_there_is_named(tmp_path, monkeypatch, capsys):
    code, seen = run_bench(monkeypatch, "--config", str(tmp_path / "none.toml"))
    assert code == 2 and seen == [] and "none.toml" in capsys.readouterr().err
