"""Cleaning takes what is the suite's own and of no more use; all else stays as it is."""

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from toy_stages import ToyConfig, toy_graph

from replicate.base import jit_cache
from replicate.engine import cache_report, store
from replicate.engine.cache_report import clean, inventory
from replicate.engine.scheduler import run
from replicate.engine.stage import Stage, in_order

OTHER = "coarse-teen-0123456789abcdef"


@pytest.fixture(scope="module")
def whole_cache(tmp_path_factory):
    """A cache that holds the toy graph, made once for all tests."""
    folder = tmp_path_factory.mktemp("whole") / "cache"
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("REPLICATE_CACHE", str(folder))
        run(toy_graph())
    return folder


@pytest.fixture
def folders(cache, whole_cache):
    """The toy graph's folders, by title, in a cache of the test's own."""
    shutil.copytree(whole_cache, cache)
    return {stage.title: cache / stage.identifier for stage in in_order(toy_graph())}


def start(cache: Path, *arguments: object) -> subprocess.Popen:
    """Start the toy graph in a process of its own."""
    tests = Path(__file__).parents[1]
    path = os.pathsep.join([str(tests), str(tests.parent)])
    environment = {**os.environ, "REPLICATE_CACHE": str(cache), "PYTHONPATH": path}
    command = [sys.executable, str(tests / "toy_stages.py"), *map(str, arguments)]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def everything(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


def foreign(cache: Path) -> list[Path]:
    """Put into a cache what is somebody else's; return all of it."""
    for name in ("thesis", "damaged-goods", "scratch/theirs", "partial/theirs", "logs/app", OTHER):
        (cache / name).mkdir(parents=True, exist_ok=True)
        (cache / name / "file").write_text("theirs")
    (cache / "thesis" / "manifest.json").write_text("{}")
    (cache / OTHER / "manifest.json").write_text(json.dumps({"stage": "coarse-teen", "key": "0123456789abcdef"}))
    (cache / "logs" / "app.log").write_text("theirs")
    return [path for path in cache.rglob("*") if path.is_file() and path.read_text() in ("theirs", "{}")]


@pytest.mark.parametrize("all_of_it", [False, True])
def test_what_the_suite_did_not_make_stays(cache, folders, capfd, all_of_it):
    theirs = foreign(cache)
    clean(all_of_it)
    assert all(file.is_file() for file in theirs) and len(theirs) >= 8
    errors = capfd.readouterr().err
    assert all(str(cache / name) in errors for name in ("thesis", "scratch/theirs", "logs/app", OTHER))
    assert all(folder.exists() != all_of_it for folder in folders.values())


def test_a_folder_that_was_never_a_cache_is_left_alone(cache, folders, capfd):
    theirs = foreign(cache)
    (cache / store.MARKER).unlink()
    before = everything(cache)
    assert clean(True) == (0, 0)
    assert store.MARKER in capfd.readouterr().err
    assert everything(cache) == before and theirs


def test_a_cache_from_before_the_marker_is_cleaned_if_it_holds_nothing_else(cache, folders):
    (cache / store.MARKER).unlink()
    assert clean(True)[0] >= len(folders)
    assert inventory() == []


@pytest.mark.parametrize("place", ["scratch", "."])
def test_links_are_neither_removed_nor_followed(cache, folders, capfd, tmp_path, place):
    target = tmp_path / "photographs"
    target.mkdir()
    (target / "one.png").write_text("mine")
    link = cache / place / OTHER
    link.symlink_to(target)
    clean(True)
    assert link.is_symlink() and (target / "one.png").read_text() == "mine"
    assert inventory() == []


def test_a_link_inside_an_unfinished_folder_is_not_followed(cache, folders, tmp_path):
    (tmp_path / "mine").write_text("mine")
    scratch = cache / "scratch" / OTHER
    scratch.mkdir()
    (scratch / "link").symlink_to(tmp_path)
    clean()
    assert not scratch.exists() and (tmp_path / "mine").read_text() == "mine"


@pytest.mark.parametrize("harm", ["missing", "damaged", "no manifest"])
def test_a_missing_or_damaged_input_is_no_reason_to_remove_what_was_made_from_it(cache, folders, harm):
    first = folders["first"]
    if harm == "missing":
        shutil.rmtree(first)
    elif harm == "damaged":
        (first / "manifest.json").write_text("{}")
    else:
        (first / "manifest.json").unlink()
    clean()
    assert all(folder.is_dir() for title, folder in folders.items() if title != "first")
    assert (folders["last"] / "numbers.json").is_file()


def test_what_was_made_from_changed_sources_goes_with_all_that_was_made_from_it(cache, folders, monkeypatch):
    digest = cache_report.sources_digest
    name = store.read_manifest(folders["middle-1"])["function"]
    monkeypatch.setattr(
        cache_report, "sources_digest", lambda function: "changed" if "total" in function else digest(function)
    )
    assert name == "toy_stages:numbers"
    clean()
    assert [title for title, folder in folders.items() if not folder.exists()] == ["last"]


def test_a_function_from_outside_the_project_that_is_out_of_sight_is_not_stale(cache, folders, monkeypatch):
    def no_digest(function: str) -> str:
        raise ValueError(f"{function}: there is no module")

    monkeypatch.setattr(cache_report, "sources_digest", no_digest)
    clean()
    assert all(folder.is_dir() for folder in folders.values())


def test_a_damaged_artefact_that_was_set_aside_goes(cache, folders, capfd):
    file = folders["first"] / "numbers.json"
    file.write_text("[]")
    assert store.load(folders["first"].name) is None
    assert (cache / f"damaged-{folders['first'].name}").is_dir()
    clean()
    assert not (cache / f"damaged-{folders['first'].name}").exists()


def kernels(cache: Path, name: str, *others: str) -> Path:
    """Put a folder of compiled kernels into a cache, with other files in it."""
    folder = cache / name
    folder.mkdir(parents=True)
    for file in ("replicate.geometry.rays._first-0123456789abcdef.code", *others):
        (folder / file).write_text("compiled")
    return folder


def test_kernels_of_other_sources_are_stale_and_half_written_ones_go_with_them(cache, folders):
    own = kernels(cache, jit_cache.folder_name(jit_cache.kernel_sources()))
    old = kernels(cache, "kernels-0123456789abcdef", ".new-01234567-first-0123456789abcdef.code")
    states = {entry.folder: entry.state for entry in inventory()}
    assert states[own] == "current" and states[old] == "stale"
    clean()
    assert own.is_dir() and not old.exists()
    clean(True)
    assert not own.exists()


@pytest.mark.parametrize("other", ["thesis.txt", "kernel.code", "folder"])
def test_a_folder_that_holds_more_than_kernels_stays(cache, folders, other):
    theirs = kernels(cache, "kernels-0123456789abcdef")
    (theirs / other).mkdir() if other == "folder" else (theirs / other).touch()
    clean(True)
    assert theirs.is_dir() and len(list(theirs.iterdir())) == 2


HOLD = """
import sys, time
from replicate.engine.store import lock
with lock(sys.argv[1]):
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.mark.parametrize("all_of_it", [False, True])
def test_what_a_stage_is_working_on_stays_and_artefacts_while_it_does(cache, folders, capfd, all_of_it):
    busy, idle = (cache / "scratch" / f"{name}-0123456789abcdef" for name in ("busy", "idle"))
    busy.mkdir()
    idle.mkdir()
    holder = subprocess.Popen([sys.executable, "-c", HOLD, busy.name], stdout=subprocess.PIPE)
    try:
        assert holder.stdout.readline() == b"held\n"
        clean(all_of_it)
        assert busy.is_dir() and not idle.exists()
        assert all(folder.is_dir() for folder in folders.values())
    finally:
        holder.kill()
        holder.communicate()
    errors = capfd.readouterr().err
    assert str(busy) in errors and "in use by a run" in errors
    assert ("a run goes on in this cache" in errors) == all_of_it


def test_cleaning_again_and_again_beside_a_run_changes_nothing_of_it(cache, tmp_path, capfd):
    undisturbed = tmp_path / "undisturbed"
    assert start(undisturbed, 0.05, 10, 2).wait(60) == 0
    process = start(cache, 0.05, 10, 2)
    while not (cache / "locks").is_dir():
        time.sleep(0.01)
    count = 0
    while process.poll() is None:
        clean(True)
        count += 1
        time.sleep(0.02)
    assert process.returncode == 0, process.communicate()
    assert count > 3
    capfd.readouterr()
    graph = toy_graph(0.05, 10)
    if all((cache / stage.identifier).exists() for stage in in_order(graph)):  # the last look may come after the end
        for stage in in_order(graph):
            one, other = (store.read_manifest(folder / stage.identifier)["files"] for folder in (cache, undisturbed))
            assert one == other


def test_the_lock_of_a_killed_run_does_not_keep_the_cache_from_being_cleaned(cache, folders):
    (cache / "locks" / "run@elsewhere-1.lock").write_text("")
    assert clean(True)[0] >= len(folders) and inventory() == []
    assert not (cache / "locks" / "run@elsewhere-1.lock").exists()


def test_what_cannot_be_removed_is_named(cache, folders, capfd, monkeypatch):
    def refuse(folder):
        raise PermissionError(13, "Permission denied", str(folder))

    monkeypatch.setattr(cache_report.shutil, "rmtree", refuse)
    (cache / "scratch" / OTHER).mkdir()
    clean()
    errors = capfd.readouterr().err
    assert f"{cache / 'scratch' / OTHER} (it can't be removed: Permission denied)" in errors


def test_a_long_list_of_what_stays_is_counted(cache, folders, capfd):
    for number in range(30):
        (cache / "scratch" / f"theirs{number}").mkdir()
    clean()
    errors = capfd.readouterr().err
    assert errors.count("\n") == 1 and "and 20 more" in errors


def test_a_run_of_one_stage_leaves_a_cache_that_says_what_it_is(cache):
    run([Stage("alone", "toy_stages:numbers", ToyConfig())])
    assert (cache / ".replicate-cache").is_file() and os.listdir(cache / "partial") == []
