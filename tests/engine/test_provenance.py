"""A manifest says where its numbers come from, in a checkout or outside one."""

import json
import platform
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from plain_rig import PlainRig
from toy_stages import toy_graph

from replicate.base.paths import ROOT
from replicate.engine.provenance import (
    core_count,
    git_state,
    graph_git,
    instruction_set,
    peak_memory_mb,
    processor,
    provenance,
    stage_facts,
    surroundings,
)
from replicate.engine.scheduler import run
from replicate.engine.store import artefact_folder, read_manifest
from replicate.methods import artefacts


@pytest.fixture
def checkout(tmp_path):
    if shutil.which("git") is None:
        pytest.skip("needs git")
    folder = tmp_path / "checkout"
    folder.mkdir()
    identity = ("-c", "user.name=A", "-c", "user.email=a@example.org")
    (folder / "file").write_text("1")
    for command in (["init", "-q"], ["add", "file"], [*identity, "commit", "-q", "-m", "Begin"]):
        subprocess.run(["git", "-C", str(folder), *command], check=True, capture_output=True)
    return folder


def test_a_clean_checkout_and_a_changed_one_are_told_apart(checkout):
    clean = git_state(checkout)
    assert clean["clean"] is True and len(clean["commit"]) == 40
    (checkout / "file").write_text("2")
    assert git_state(checkout) == {**clean, "clean": False}


def test_outside_a_checkout_there_is_no_commit(checkout):
    (checkout / "unpacked").mkdir()
    assert git_state(checkout / "unpacked") is None, "the repository around it is not this suite's"


def test_provenance_is_json_with_all_that_a_reader_asks_for():
    facts = provenance(["make", "table2"], "quick", [3], 2)
    assert json.loads(json.dumps(facts)) == facts
    assert facts["command"] == "make table2" and facts["profile"] == "quick" and facts["seeds"] == [3]
    assert facts["workers"] == 2 and facts["cores"] == core_count() >= 1
    assert {"numpy", "torch", "jax"} <= set(facts["packages"]) and processor()


def test_provenance_does_not_load_torch():
    program = (
        "import sys; from replicate.engine.provenance import provenance; facts = provenance([], 'quick', [0], 1);"
        "print(facts['gpu'], 'torch' in sys.modules)"
    )
    process = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert process.stdout.split() == ["None", "False"]


def test_stage_facts_name_every_stage_with_its_time(cache):
    run(toy_graph())
    facts = stage_facts(toy_graph())
    assert list(facts) == ["first", "middle-0", "middle-1", "middle-2", "last"]
    assert all(fact["wall_s"] >= 0 for fact in facts.values())
    assert facts["first"]["notes"] == {"count": 3}


@pytest.fixture
def mixed(cache):
    """Return a function that makes the toys' first stage in one git state and the others in another."""

    def make(first, others):
        graph = toy_graph()
        run([graph[0].inputs[0].inputs[0]], facts={"git": first})
        run(graph, facts={"git": others})
        return graph

    return make


OLD, NEW = {"commit": "c0ffee", "clean": True}, {"commit": "f00d", "clean": True}


def test_stages_of_one_commit_name_it_once(mixed):
    graph = mixed(NEW, NEW)
    assert graph_git(graph) == NEW
    assert not any("git" in fact for fact in stage_facts(graph).values())


def test_a_stage_of_another_commit_names_its_own(mixed):
    graph = mixed(OLD, NEW)
    assert graph_git(graph) == {**NEW, "commits": ["c0ffee", "f00d"]}
    assert {title: fact["git"] for title, fact in stage_facts(graph).items() if "git" in fact} == {"first": OLD}


def test_one_stage_of_a_changed_tree_makes_all_unclean(mixed):
    graph = mixed({**NEW, "clean": False}, NEW)
    top, facts = graph_git(graph), stage_facts(graph)
    assert top == {**NEW, "clean": False}
    flags = {title: fact.get("git", top)["clean"] for title, fact in facts.items()}
    assert flags.pop("first") is False and all(flags.values()), "each stage's own flag can be read from the facts"


def test_a_stage_from_outside_a_checkout_is_not_clean(mixed):
    graph = mixed(None, NEW)
    assert graph_git(graph) == {**NEW, "clean": False}
    facts = stage_facts(graph)
    assert facts["first"]["git"] is None and facts["last"]["git"] == NEW


def test_a_graph_from_outside_a_checkout_has_no_commit(mixed):
    graph = mixed(OLD, None)
    assert graph_git(graph) is None and stage_facts(graph)["first"]["git"] == OLD


def test_a_rig_built_outside_a_graph_says_what_it_was_made_from(monkeypatch, tmp_path, cache):
    record, folders = {}, []

    def run(stages, facts):
        record.update(facts)
        return {stage.title: tmp_path / stage.identifier for stage in stages}

    monkeypatch.setattr("replicate.engine.scheduler.run", run)
    monkeypatch.setattr("data_recipes.catalogue.load_rig", lambda folder: folders.append(folder) or PlainRig())
    assert isinstance(artefacts.rig_of("tiny"), PlainRig)
    assert [folder.parent.name for folder in folders] == [artefacts.rig_identifier("tiny")]
    assert record["git"] == git_state() and record["command"].startswith("python ")


def test_a_rig_that_is_there_is_read_without_a_word(monkeypatch, tmp_path, capfd):
    monkeypatch.setattr("replicate.engine.store.load", lambda identifier: tmp_path / identifier)
    monkeypatch.setattr("data_recipes.catalogue.load_rig", lambda folder: PlainRig())
    assert isinstance(artefacts.rig_of("tiny"), PlainRig)
    assert capfd.readouterr().out == ""


def test_a_process_does_not_count_the_memory_of_the_one_that_started_it():
    block = np.ones(40_000_000)
    ask = "from replicate.engine.provenance import peak_memory_mb; print(peak_memory_mb())"
    child = subprocess.run([sys.executable, "-c", ask], cwd=ROOT, capture_output=True, text=True, check=True)
    assert peak_memory_mb() > block.nbytes / 2**20 > 300 > float(child.stdout) > 5


ELSEWHERE = {"processor": "another", "instruction_set": "x86_64 avx2", "packages": {"numpy": "2.0", "torch": "2.1"}}


def test_a_stage_made_with_other_packages_or_on_another_processor_says_so(cache):
    here = {"git": NEW, "processor": "one", "instruction_set": "x86_64 avx2", "packages": {"numpy": "2.0"}}
    graph = toy_graph()
    run([graph[0].inputs[0].inputs[0]], facts={"git": NEW})
    run(graph, facts=here)
    first = artefact_folder(graph[0].inputs[0].inputs[0].identifier)
    manifest = read_manifest(first)
    (first / "manifest.json").write_text(json.dumps(manifest | {"surroundings": ELSEWHERE}))
    facts = stage_facts(graph)
    assert facts["first"]["processor"] == "another" and facts["first"]["packages"] == {"torch": "2.1"}
    assert "instruction_set" not in facts["first"] and "python" not in facts["first"]


def test_stages_made_here_say_nothing_of_it(cache):
    graph = toy_graph()
    run(graph, facts=provenance([], "quick", [0], 1))
    facts = stage_facts(graph)
    assert not any({"packages", "processor", "instruction_set", "python"} & set(fact) for fact in facts.values())
    worker = read_manifest(artefact_folder(graph[0].identifier))["surroundings"]
    assert worker == surroundings() and worker["packages"]["numpy"]


def test_the_instruction_set_is_that_of_this_processor():
    assert instruction_set().split()[0] == platform.machine()
    cpu = Path("/proc/cpuinfo")
    if cpu.is_file() and " avx2 " in cpu.read_text():
        assert "avx2" in instruction_set().split() and "sse2" not in instruction_set().split()
