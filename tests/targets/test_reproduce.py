"""`make reproduce`: its list covers what is committed, and a stopped run goes on where it was."""

import argparse
import importlib.util
import itertools
import json
import shlex
import sys

import pytest

from replicate.base.exceptions import InputError, RunError
from replicate.base.paths import REFERENCE
from replicate.cli.options import words
from replicate.cli.parser import parser
from replicate.methods.method_registry import choose
from replicate.report import manifest
from replicate.targets import reproduce
from replicate.targets.reproduce import Step

STEPS = reproduce.read_steps()
NO_CHOICE = argparse.Namespace(details=False)


def test_every_command_is_one_that_there_is():
    assert len({step.command for step in STEPS}) == len(STEPS)
    for step in STEPS:
        name, *rest = shlex.split(step.command)
        if name.startswith(reproduce.BENCH):
            assert importlib.util.find_spec(f"replicate.benchmarks.{name}") and step.minutes
            assert "--characters" in rest or name == "bench_growth", "what a benchmark takes by itself may change"
        else:
            options = parser().parse_args([name, *rest])
            choose(words(getattr(options, "methods", "")))


def test_every_table_that_is_committed_is_made_by_a_command():
    made = {name: characters(name) for name in {shlex.split(step.command)[0].replace("-", "_") for step in STEPS}}
    committed = {name: set(manifest.entries(REFERENCE, name)) for name in manifest.targets(REFERENCE)}
    assert set(committed) <= set(made)
    committed["table2"] = set(manifest.entries(REFERENCE, manifest.TOP))
    committed["bench_ladder"] = {name.partition("@")[0] for name in committed["bench_ladder"]}  # makes variants itself
    for name in set(committed) - {"bench_growth"}:  # which has none
        # `rigify` makes that character's Table 2, from which its figures are drawn
        assert committed[name] - {"rigify"} <= made[name], name


def characters(target):
    """The characters that all steps of a target name."""
    found = set()
    for step in STEPS:
        name, *rest = shlex.split(step.command)
        if name.replace("-", "_") == target and "--characters" in rest:
            behind = rest[rest.index("--characters") + 1 :]
            found |= set(",".join(itertools.takewhile(lambda word: not word.startswith("--"), behind)).split(","))
    return found


@pytest.fixture
def three(monkeypatch, tmp_path):
    """Three commands that write into a file which runs there were; the second fails until `mended` is there."""
    log, mended = tmp_path / "log", tmp_path / "mended"
    code = (
        "import pathlib, sys; p = pathlib.Path(sys.argv[1]); p.open('a').write(sys.argv[2]);"
        "sys.exit(3 if sys.argv[2] == 'b' and not pathlib.Path(sys.argv[3]).exists() else 0)"
    )
    monkeypatch.setattr(
        Step, "words", lambda step: [sys.executable, "-c", code, str(log), step.command, str(mended)], raising=True
    )
    steps = [Step("a"), Step("b", needs="pytest"), Step("c"), Step("d", needs="pytest no_such_module_anywhere")]
    monkeypatch.setattr(reproduce, "read_steps", lambda: steps)
    monkeypatch.setattr(reproduce, "stages_of", lambda step: [])
    monkeypatch.setattr(reproduce, "git_state", lambda: {"commit": "1" * 40, "clean": True})
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path))
    return log, mended


def test_a_run_that_fails_goes_on_with_the_command_that_failed(three, monkeypatch, capsys, tmp_path):
    log, mended = three
    with pytest.raises(RunError, match="b: exit code 3; `make reproduce` goes on there"):
        reproduce.run(NO_CHOICE)
    mended.touch()
    reproduce.run(NO_CHOICE)
    assert log.read_text() == "abbc"
    assert "left out    d (no_such_module_anywhere is missing)" in capsys.readouterr().out
    reproduce.run(NO_CHOICE)
    assert log.read_text() == "abbc" and "are done at 1111111" in capsys.readouterr().out
    monkeypatch.setattr(reproduce, "git_state", lambda: {"commit": "2" * 40, "clean": True})
    reproduce.run(NO_CHOICE)
    assert log.read_text() == "abbcabc", "another commit's results are others"
    assert set(json.loads((tmp_path / reproduce.DONE).read_text()).values()) == {"2" * 40}


def test_details_only_say_what_would_be_done(three, capsys):
    reproduce.run(argparse.Namespace(details=True))
    assert not three[0].exists() and capsys.readouterr().out.startswith("3 of 4 commands to do at 1111111, about")


def test_results_come_from_a_commit(three, monkeypatch):
    monkeypatch.setattr(reproduce, "git_state", lambda: {"commit": "1" * 40, "clean": False})
    with pytest.raises(InputError, match="commit your changes first"):
        reproduce.run(NO_CHOICE)


def test_the_time_of_shared_stages_counts_once():
    step, seen = Step("table2 --characters tiny --profile quick --methods coarse"), set()
    graph = {stage.identifier for stage in reproduce.stages_of(step)}
    assert graph and reproduce._training_s(step, seen) >= 0 and seen <= graph
    assert reproduce._training_s(step, seen) == 0
