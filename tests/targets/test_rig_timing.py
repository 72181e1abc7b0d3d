"""Table 3 times all rigs of a run in one stage; they take turns in rounds, and the rows of each are its own."""

from contextlib import contextmanager, nullcontext
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from replicate.cli.running import Known, stage_s
from replicate.config import resolve
from replicate.engine.stage import StageContext, in_order
from replicate.methods.method_registry import choose
from replicate.methods.plan import Plan
from replicate.targets import table3
from replicate.targets.table3 import rows
from replicate.targets.table3.rows import RigSettings, RowsSettings
from replicate.timing.single_poses import Turns, Way

METHODS = choose(["coarse", "lbs16", "linear"])


def plans(*seeds):
    return [Plan(resolve("tiny", "quick", seed=seed)) for seed in seeds]


def test_rigs_of_a_run_are_timed_together_and_each_reads_its_own_artefacts():
    rigs = plans(0, 1)
    timing = table3.timing_stage([(plan, METHODS) for plan in rigs], "now")
    titles = [stage.title for stage in timing.inputs]
    assert timing.title == "timing-2_rigs" and timing.threads == 0 and len(titles) == len(set(titles))
    artefacts = {title: Path(title) for title in titles}
    first, second = (rig.inputs_of(artefacts) for rig in timing.config.rigs)
    assert [own["coarse"].name for own in (first, second)] == ["coarse-tiny", "coarse-tiny-seed1"]
    assert first["rig"] == second["rig"] and "lbs16" not in first, "an oracle has no time"
    measured = {path for title, path in artefacts.items() if title.startswith("errors_")}  # they only have to be there
    assert {*first.values(), *second.values()} == {*artefacts.values()} - measured and len(measured) == 4


def test_each_character_gets_its_rows_from_the_measurement_of_all():
    rigs = plans(0, 1)
    timing = table3.timing_stage([(plan, METHODS) for plan in rigs], "now")
    tables = [table3.stages(plan, METHODS, timing)[-1] for plan in rigs]
    assert [stage.title for stage in tables] == ["table3-tiny", "table3-tiny-seed1"]
    assert [stage.inputs for stage in tables] == [(timing,), (timing,)]
    assert [stage.config.file for stage in tables] == [one.file for one in timing.config.rigs]
    assert len({stage.config.file for stage in tables}) == 2


def test_a_later_measurement_is_another_one():
    (plan,) = plans(0)
    keys = {table3.timing_stage([(plan, METHODS)], measured).key for measured in ("9:00", "9:10")}
    assert len(keys) == 2 and "timing-tiny" in [stage.title for stage in in_order(table3.stages(plan, METHODS))]


def test_the_rows_of_a_character_are_a_file_of_the_measurement(tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "tiny-seed0.csv").write_text("rows")
    settings = RowsSettings("tiny-seed0.csv")
    table3.read_rows(StageContext("table3", settings, {"timing": tmp_path / "in"}, tmp_path, tmp_path))
    assert (tmp_path / "table3.csv").read_text() == "rows"


@pytest.fixture
def rounds(monkeypatch):
    """(evaluations by rig) → whose turn it was, where, and how many evaluations it had, in order; and the progress."""
    seen = []

    class Recorder:
        def __init__(self, name, where):
            self.key = name, where

        def take(self, evaluations, advance):
            seen.append((*self.key, evaluations))
            advance(evaluations)

    class Rig(rows.TimedRig):
        def __init__(self, name):
            self.turns = {where: Recorder(name, where) for where in ("all", "one")}

    def run(evaluations):
        monkeypatch.setattr(rows, "settings_of_cores", lambda: [(w, nullcontext()) for w in ("all", "one")])
        done = []

        @contextmanager
        def progress(total, label):
            yield SimpleNamespace(update=done.append)
            assert sum(done) == total

        rigs = {RigSettings(name, "quick", (), (), count, (), ""): Rig(name) for name, count in evaluations.items()}
        rows.take_turns(rigs, progress)
        return [turn for turn in seen if turn[2]]

    return run


def test_in_each_round_every_rig_has_its_turn_on_all_cores_and_on_one(rounds):
    whole = rows.ROUND
    turns = rounds({"a": 2 * whole + 1, "b": whole})
    first = [("a", "all", whole), ("a", "one", whole), ("b", "all", whole), ("b", "one", whole)]
    assert turns == [*first, *first[:2], ("a", "all", 1), ("a", "one", 1)]


def test_a_round_has_one_turn_of_the_ways_that_a_quicker_one_beats():
    ways = {"slow": Way(len, every=rows.PEERS_EVERY), "quick": Way(len)}
    turns = Turns(ways, np.zeros((3, 2)))
    for k in range(1, 4):
        turns.take(rows.ROUND, lambda done: None)
        times = turns.times()
        assert times["quick"].evaluations == k * rows.ROUND == 5 * times["slow"].evaluations


def test_the_time_of_a_measurement_is_in_proportion_to_the_number_of_rigs():
    timing = table3.timing_stage([(plan, METHODS) for plan in plans(0, 1)], "now")
    known = {
        "timing-4_rigs": Known(480.0, "laptop"),
        "timing-5_rigs": Known(900.0, "laptop"),
        "coarse-tiny": Known(1, ""),
    }
    assert stage_s(timing, known) == 240 and stage_s(timing, {}) is None
