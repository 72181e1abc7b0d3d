"""A graph ends with the same artefacts however often it is killed, and says in one sentence why it could not go on."""

import json
import os
import random
import signal
import sys
import time
from dataclasses import replace
from pathlib import Path

import psutil
import pytest
from toy_runs import TOYS, contents, launch, own_children, start
from toy_stages import ToyConfig, faulty_graph, toy_graph

from replicate.base.exceptions import InputError, RunError
from replicate.engine import store
from replicate.engine.scheduler import Forecast, run
from replicate.engine.stage import Stage, in_order


def children_after(process, count, seconds=10.0):
    """Return the children of a process once there are enough of them."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline and process.poll() is None:
        children = psutil.Process(process.pid).children(recursive=True)
        if len(children) >= count:
            return children
        time.sleep(0.02)
    raise AssertionError(f"fewer than {count} workers within {seconds} s")


def test_the_number_of_workers_does_not_change_the_results(cache, monkeypatch, tmp_path, capfd):
    run(toy_graph(), workers=1)
    alone = contents(cache, toy_graph())
    monkeypatch.setenv("REPLICATE_CACHE", str(tmp_path / "other"))
    folders = run(toy_graph(), workers=4)
    assert contents(tmp_path / "other", toy_graph()) == alone
    assert sorted(folders) == ["first", "last", "middle-0", "middle-1", "middle-2"]
    assert len(json.loads((folders["last"] / "numbers.json").read_text())) == 3
    assert "made 5 of 5 artefacts" in capfd.readouterr().out


def test_a_second_run_does_nothing_and_says_so(cache, capfd):
    run(toy_graph())
    capfd.readouterr()
    beginning = time.monotonic()
    run(toy_graph())
    assert capfd.readouterr().out == "nothing to do: 5 artefacts up to date\n"
    run([*toy_graph()[0].inputs[0].inputs])
    assert capfd.readouterr().out == "nothing to do: 1 artefact up to date\n"
    assert time.monotonic() - beginning < 5


def test_what_is_missing_is_foreseen_before_it_is_made(cache, capfd):
    asked = []

    def foresee(missing):
        asked.append([stage.title for stage in missing])
        assert not store.artefact_folder(missing[0].identifier).exists()
        return "half a minute or so", {}

    run(toy_graph(), foresee=foresee)
    assert sorted(asked[0]) == ["first", "last", "middle-0", "middle-1", "middle-2"]
    assert capfd.readouterr().out.startswith("half a minute or so\n")
    run(toy_graph(), foresee=foresee)
    assert len(asked) == 1 and "nothing to do" in capfd.readouterr().out


def test_whoever_wants_to_know_is_told_which_artefacts_are_there(cache):
    told = []
    stages = toy_graph()
    graph = in_order(stages)
    run(graph[:1])
    run(stages, arrived=lambda there: told.append(set(there)))
    assert told[0] == {graph[0].identifier} and told[-1] == {stage.identifier for stage in graph}
    assert [len(there) for there in told] == [1, 2, 3, 4, 5]


def test_a_graph_killed_at_ten_random_moments_ends_with_the_same_numbers(cache, tmp_path):
    undisturbed = tmp_path / "undisturbed"
    assert start(undisturbed, 0.04, 12, 2).wait(60) == 0
    moments = random.Random(2020)
    for _ in range(10):
        process = start(cache, 0.04, 12, 2)
        time.sleep(moments.uniform(0.1, 1.0))
        children = psutil.Process(process.pid).children(recursive=True) if process.poll() is None else []
        process.kill()
        process.wait()
        _, alive = psutil.wait_procs(children, timeout=10)
        assert not alive, "a worker outlived its parent"
    process = start(cache, 0.04, 12, 2)
    assert process.wait(60) == 0
    graph = toy_graph(0.04, 12)
    assert contents(cache, graph) == contents(undisturbed, graph)


def test_work_goes_on_from_the_checkpoint_of_a_killed_run(cache):
    stage = Stage("slow", "toy_stages:numbers", ToyConfig(steps=4))
    scratch = store.scratch_folder(stage.identifier)
    scratch.mkdir(parents=True)
    (scratch / "steps.json").write_text("[1.0, 2.0, 3.0]")
    folder = run([stage])["slow"]
    assert json.loads((folder / "numbers.json").read_text())[:3] == [1.0, 2.0, 3.0]
    assert store.read_manifest(folder)["resumed"] is True


def test_a_flipped_byte_is_named_and_only_that_artefact_is_made_again(cache, capfd):
    folders = run(toy_graph())
    file = folders["middle-1"] / "numbers.json"
    before = file.read_bytes()
    file.write_bytes(before.replace(b".", b",", 1))
    capfd.readouterr()
    run(toy_graph())
    streams = capfd.readouterr()
    assert "made 1 of 5 artefacts" in streams.out
    assert str(folders["middle-1"]) in streams.err and "numbers.json" in streams.err
    assert file.read_bytes() == before


def test_two_processes_at_once_make_each_artefact_once(cache, tmp_path):
    builds = tmp_path / "builds.txt"
    both = [start(cache, 0.15, 6, 2, TOY_BUILDS=str(builds)) for _ in range(2)]
    outputs = [process.communicate(timeout=60) for process in both]
    assert [process.returncode for process in both] == [0, 0], outputs
    assert outputs[0][0].splitlines()[-1] == outputs[1][0].splitlines()[-1]
    lines = builds.read_text().splitlines()
    assert sorted(lines) == sorted(set(lines)) and len(lines) == 4
    assert any("being made by another process" in errors for _, errors in outputs)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_signal_ends_the_run_and_its_workers_at_once_and_says_so(cache, number):
    process = start(cache, 1.0, 20, 2)
    children = children_after(process, 1)
    process.send_signal(number)
    errors = process.communicate(timeout=10)[1]
    _, alive = psutil.wait_procs(children, timeout=5)
    assert not alive
    if number == signal.SIGINT:  # the command line has a line and an exit code for it
        assert "KeyboardInterrupt" in errors and process.returncode == -signal.SIGINT
    else:
        name = signal.Signals(number).name
        assert errors == f"ended by {name}: what is finished is kept, and the same command goes on from there\n"
        assert process.returncode == 128 + number


def test_under_nohup_a_run_outlives_its_terminal(cache):
    process = launch(["nohup", sys.executable, TOYS, "0.3", "4", "2"], cache)
    children_after(process, 1)
    process.send_signal(signal.SIGHUP)
    out, errors = process.communicate(timeout=60)
    assert process.returncode == 0 and "made 5 of 5 artefacts" in out, errors


def test_a_stage_is_not_made_from_sources_that_were_edited_after_the_start(cache, tmp_path, monkeypatch):
    module = tmp_path / "edited.py"
    module.write_text("def build(context):\n    (context.out / 'number').write_text('1')\n")
    monkeypatch.syspath_prepend(tmp_path)
    stage = Stage("late", "edited:build", ToyConfig())
    assert stage.identifier  # the key is that of the sources as they are now
    module.write_text(module.read_text().replace("'1'", "'2'"))
    with pytest.raises(RunError, match=r"^late: the sources in .* on .* are not those that the run was started with;"):
        run([stage])
    assert not list(cache.glob("late-*"))


def test_a_killed_worker_ends_the_run_with_a_sentence(cache):
    beginning = time.monotonic()
    with pytest.raises(RunError, match=r"stage faulty was killed by SIGKILL.*its log is .*faulty-.*\.log") as error:
        run(faulty_graph("kill"), workers=2)
    assert "\n" not in str(error.value)
    assert time.monotonic() - beginning < 30, "the other stage, of a minute, was not ended"
    assert not own_children()
    assert not list((cache / "partial").glob("*")), "what the killed stage had written takes up room"


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        ("kill", r"stage faulty was killed by SIGKILL, probably because memory ran out; its log is "),
        ("abort", r"stage faulty was killed by SIGABRT, perhaps because memory ran out; its log is "),
        ("exit", r"stage faulty ended by itself with exit code 1, perhaps because memory ran out; its log is "),
        ("memory", r"stage faulty ran out of memory \(MemoryError\); its log is "),
    ],
)
def test_a_stage_that_finds_no_memory_ends_with_a_sentence_about_memory(cache, fault, sentence):
    with pytest.raises(RunError, match=sentence) as error:
        run(faulty_graph(fault)[1:], workers=1)
    log = Path(str(error.value).rpartition("its log is ")[2])
    assert fault != "memory" or "MemoryError" in log.read_text()


def test_a_failed_stage_leaves_its_traceback_in_the_log_it_names(cache):
    with pytest.raises(RunError, match=r"stage faulty failed \(RuntimeError: the fault that was asked for\)") as error:
        run(faulty_graph("error"), workers=2)
    log = Path(str(error.value).rpartition("its log is ")[2])
    assert "Traceback" in log.read_text()
    assert not list(cache.glob("faulty-*"))


@pytest.mark.parametrize("threads", [1, 2], ids=["fork", "new Python"])
@pytest.mark.parametrize("code", [0, 3])
def test_a_stage_that_calls_sys_exit_ends_the_run_with_a_sentence(cache, code, threads):
    stage = replace(faulty_graph(f"exit {code}")[1], threads=threads)
    where = rf"toy_stages\.py: faulty called sys\.exit\({code}\), where it had to return"
    with pytest.raises(RunError, match=rf"^stage faulty failed \(.*{where}\); its log is .*faulty-.*\.log$"):
        run([stage], workers=2)
    assert not list(cache.glob("faulty-*"))


@pytest.mark.parametrize("threads", [1, 2], ids=["fork", "new Python"])
def test_what_lies_beside_a_stages_module_is_found_last(cache, tmp_path, monkeypatch, threads):
    for name in ("random", "numpy", "json", "torch", "replicate"):
        (tmp_path / f"{name}.py").write_text("raise RuntimeError('a neighbour was taken for the library')\n")
    (tmp_path / "beside.py").write_text("ANSWER = '42'\n")
    (tmp_path / "visited.py").write_text(
        "import json, random\nimport numpy\nimport beside\n\ndef look(context):\n"
        "    random.random(), numpy.zeros(1), json.dumps(1)\n"
        "    (context.out / 'answer').write_text(beside.ANSWER)\n"
    )
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path)])
    stage = Stage("visit", "visited:look", ToyConfig(), threads=threads)
    assert (run([stage], workers=2)["visit"] / "answer").read_text() == "42"


def test_a_failure_that_is_noted_costs_only_what_needs_it(cache, capfd):
    _, faulty = faulty_graph("error")
    (sound,) = toy_graph()
    lost = Stage("lost", "toy_stages:total", ToyConfig(), (Stage("after", "toy_stages:total", ToyConfig(), (faulty,)),))
    failures = {}
    folders = run([lost, sound], workers=2, failures=failures)
    assert list(failures) == ["faulty"] and "the fault that was asked for" in str(failures["faulty"])
    assert (folders["last"] / "numbers.json").is_file() and not folders["lost"].exists()
    assert "made 5 of 8 artefacts" in (said := capfd.readouterr().out) and "; 3 could not be made" in said
    assert not own_children()


def test_bad_input_that_a_stage_finds_is_passed_on(cache):
    with pytest.raises(InputError, match=r"^head.toml: teeth: expected an even number, got 3$"):
        run(faulty_graph("input"), workers=2)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_disk_that_fills_up_is_a_sentence_and_leaves_nothing_half_written(cache):
    with pytest.raises(RunError, match="disk is full"):
        run(faulty_graph("full"), workers=2)
    assert not list(cache.glob("faulty-*")) and not list((cache / "partial").glob("faulty-*"))


def test_a_worker_has_one_thread_unless_the_stage_asks_for_more(cache):
    one = Stage("one", "toy_stages:environment", ToyConfig())
    more = Stage("all", "toy_stages:environment", ToyConfig(), threads=0)
    folders = run([one, more], workers=3)
    for title, threads in (("one", "1"), ("all", "3")):
        variables = json.loads((folders[title] / "environment.json").read_text())
        pools = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "NPROC")
        assert {variables[pool] for pool in pools} == {threads}
        assert variables["OMP_WAIT_POLICY"] == "passive"
        assert variables["JAX_PLATFORMS"] == os.environ.get("JAX_PLATFORMS", "cpu")


def test_a_run_on_this_machine_loads_no_dask(cache):
    program = (
        "import sys, toy_stages, replicate.__main__; toy_stages.run_toys(0, 1, 1); "
        "print(*sorted({'dask', 'distributed', 'dask_jobqueue'} & {name.partition('.')[0] for name in sys.modules}))"
    )
    out, errors = launch([sys.executable, "-c", program], cache).communicate(timeout=60)
    assert out.splitlines()[-1] == "", errors


def test_without_a_terminal_a_long_stage_has_a_line_at_its_start_and_end_and_a_short_one_has_none(cache, capfd):
    slow = Stage("slow", "toy_stages:numbers", ToyConfig(steps=6, pause_s=0.4))
    run([slow, Stage("fast", "toy_stages:numbers", ToyConfig())], workers=2)
    lines = capfd.readouterr().err.splitlines()
    assert [line.split(" in ")[0] for line in lines] == ["slow: started", "slow: made"]


def test_the_manifest_tells_how_an_artefact_was_made(cache):
    folders = run(toy_graph(), facts={"profile": "quick"})
    manifest = store.read_manifest(folders["middle-1"])
    assert manifest["notes"] == {"count": 3} and manifest["run"] == {"profile": "quick"}
    assert manifest["inputs"]["first"].startswith("first-") and manifest["wall_s"] >= 0
    assert manifest["config"]["fields"]["seed"] == 1 and manifest["threads"] == 1


def test_what_is_left_of_a_run_follows_expected_times_and_what_the_first_stages_took():
    first, *_ = chain = [Stage(name, "toy_stages:numbers", ToyConfig()) for name in ("first", "second", "third")]
    expected = {stage.identifier: 600.0 for stage in chain}
    assert Forecast({}, 2).left_s(chain, {}) is None
    assert Forecast(expected, 1).left_s(chain, {}) == 1800
    assert Forecast(expected, 3).left_s(chain, {first.identifier: 100.0}) == 600, "the others are all to be done"
    slow = Forecast(expected, 1)
    slow.done(first.identifier, 1260.0)
    assert slow.left_s(chain[1:], {}) == pytest.approx(2 * 1200)
    unknown = Forecast({}, None)
    unknown.done(first.identifier, 50.0)
    assert unknown.left_s(chain[1:], {chain[1].identifier: 20.0}) == pytest.approx(30 + 50)
    slower = {chain[1].identifier: 600.0}
    assert unknown.left_s(chain[1:], {chain[1].identifier: 20.0}, slower) == pytest.approx(600 + 50), (
        "as it says itself"
    )
    assert Forecast({}, 1).left_s(chain[:1], {}, {chain[0].identifier: 90.0}) == 90


def test_a_run_is_late_once_all_that_runs_has_taken_longer_than_expected():
    first, second, third = chain = [Stage(name, "toy_stages:numbers", ToyConfig()) for name in ("1", "2", "3")]
    known = Forecast({first.identifier: 60.0, second.identifier: 90.0}, 2)
    assert not known.is_late(chain, {}, {}) and not known.is_late(chain, {first.identifier: 59.0}, {})
    assert known.is_late(chain, {first.identifier: 61.0}, {})
    assert not known.is_late(chain, {first.identifier: 61.0}, {first.identifier: 5.0}), "it knows how long it takes"
    assert not known.is_late(chain, {first.identifier: 61.0, second.identifier: 61.0}, {})
    assert known.is_late(chain, {first.identifier: 91.0, second.identifier: 91.0, third.identifier: 91.0}, {})
    assert not known.is_late(chain, {third.identifier: 1e4}, {}), "nothing was expected of it"
    unknown = Forecast({}, 2)
    assert not unknown.is_late(chain, {first.identifier: 1e4}, {})
    unknown.done(first.identifier, 50.0)
    assert unknown.is_late(chain[1:], {second.identifier: 51.0}, {}), "than the others took"


def test_inputs_come_one_after_the_other_however_many_workers_there_are():
    graph = in_order(toy_graph())
    assert Forecast({stage.identifier: 60.0 for stage in graph}, 99).left_s(graph, {}) == 3 * 60


def test_a_run_tells_how_far_it_is_as_a_whole(cache, capfd, monkeypatch):
    monkeypatch.setattr("replicate.engine.display.DELAY_S", 0.0)
    monkeypatch.setattr("replicate.engine.display.LINE_EVERY_S", 0.0)
    run(toy_graph(pause_s=0.3))
    lines = [line for line in capfd.readouterr().err.splitlines() if " of 5 artefacts, " in line]
    assert lines and all("under way" in line for line in lines)


def test_a_run_that_takes_longer_than_expected_says_so(cache, capfd, monkeypatch):
    monkeypatch.setattr("replicate.engine.display.DELAY_S", 0.0)
    monkeypatch.setattr("replicate.engine.display.LINE_EVERY_S", 0.0)
    run(toy_graph(pause_s=0.3), foresee=lambda missing: ("", {stage.identifier: 1e-3 for stage in missing}))
    assert ", longer than expected" in capfd.readouterr().err
