"""Before a character's networks are trained, standard error says in two lines at most what is amiss with it."""

import pytest

from replicate.cli import running
from replicate.cli.running import BEFORE_TRAINING, remarks_before_training
from replicate.config import resolve
from replicate.engine.stage import in_order
from replicate.methods.method_registry import choose
from replicate.methods.plan import Plan
from replicate.rig_study import first_look
from replicate.rig_study.first_look import FACE, MEANINGLESS, WORSE, Finding
from replicate.targets import figure05, table2


@pytest.fixture
def tiny():
    return resolve("tiny", "quick")


def graph(config):
    return table2.stages(Plan(config), choose(["coarse"]))


def test_a_character_is_looked_at_once_as_soon_as_what_training_begins_with_is_there(tiny, monkeypatch, capsys):
    seen = []
    monkeypatch.setattr(running, "remarks", lambda config, first: seen.append(set(first)) or ["tiny: it is odd"])
    stages = {stage.name: stage.identifier for stage in in_order(list(graph(tiny)))}
    arrived = remarks_before_training([tiny], [graph(tiny)])
    there = set()
    for name in BEFORE_TRAINING:
        assert not seen
        there.add(stages[name])
        arrived(there)
    arrived(there | {stages["coarse"]})
    assert seen == [set(BEFORE_TRAINING)] and capsys.readouterr().err == "tiny: it is odd\n"


def test_what_trains_nothing_says_nothing(tiny, monkeypatch):
    monkeypatch.setattr(running, "remarks", lambda *_: pytest.fail("nothing is to be trained"))
    stages = figure05.stages(Plan(tiny))
    remarks_before_training([tiny], [stages])({stage.identifier for stage in in_order(list(stages))})


def test_a_look_that_fails_costs_no_run(tiny, monkeypatch, capsys):
    def fails(*_):
        raise ZeroDivisionError

    monkeypatch.setattr(running, "remarks", fails)
    remarks_before_training([tiny], [graph(tiny)])({stage.identifier for stage in in_order(list(graph(tiny)))})
    assert capsys.readouterr().err == ""


def test_the_worst_is_told_and_where_the_rest_is(tiny, monkeypatch):
    found = [
        Finding(FACE, "", "size", "mm", 61.0, WORSE, "it is small"),
        Finding(FACE, "", "finite", "", 0.0, MEANINGLESS, "NaN"),
    ]
    few = Finding(FACE, "", "bad_texels_a_vertex", "count", 5.0, WORSE, "as on any large face")
    monkeypatch.setattr(first_look, "load_face", lambda *_: None)
    first = {stage.name: stage for stage in in_order(list(graph(tiny))) if stage.name in BEFORE_TRAINING}
    for findings, lines in (
        (
            found,
            ["tiny: meaningless: NaN", "tiny: `make check CHARACTERS=tiny` shows 1 more of the kind, and pictures"],
        ),
        ([*found[:1], few], ["tiny: worse: it is small", "tiny: `make check CHARACTERS=tiny` shows pictures of it"]),
        ([few], []),
    ):
        monkeypatch.setattr(first_look, "look", lambda face, tries, findings=findings: findings)
        assert running.remarks(tiny, first) == lines
