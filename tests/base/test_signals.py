"""A run ends with the make that started it, whenever that is killed, and outlives whoever else has started it."""

import os
import shutil
import signal
import sys
import time
from contextlib import suppress

import psutil
import pytest
from toy_runs import launch, processes_of, survivors, wait_for

LINE = "ended with the make that started it: what is finished is kept, and the same command goes on from there\n"
STAGE = "replicate.engine.worker"
DOOR = "import sys; from replicate.base.command_line import run; sys.exit(run(sys.argv.pop(1)))"
TOYS = "toy_stages:main 0.3 100 2"  # half a minute, and more

REAPER = """import ctypes, os, subprocess, sys
ctypes.CDLL(None).prctl(36, 1, 0, 0, 0)  # PR_SET_CHILD_SUBREAPER: orphans become its children, as an init's
subprocess.Popen(sys.argv[1:])
try:
    while True: os.wait()
except ChildProcessError: pass
"""

needs_make = pytest.mark.skipif(shutil.which("make") is None, reason="needs make")


@pytest.fixture(autouse=True)
def nothing_survives(tmp_path):
    """No process that a test has started outlives it."""
    yield
    assert survivors(tmp_path, 0) == []


@pytest.fixture
def make(cache, tmp_path):
    """Return a function that starts make, which starts Python as our Makefile does."""
    (tmp_path / "slow_imports.py").write_text("import time\ntime.sleep(60)\ndef main(): pass\n")

    def start(words: str, before: str = "", program: str = DOOR, below: tuple[str, ...] = ()):
        python = f"exec {sys.executable} -c '{program}' {words} --from-make $(shell echo $$PPID)"
        (tmp_path / "Makefile").write_text(f"all:\n\t@{before}{python}\n")
        path = os.pathsep.join(["tests", ".", str(tmp_path)])
        return launch([*below, "make", "-f", str(tmp_path / "Makefile")], cache, PYTHONPATH=path)

    return start


def recipe(make: int) -> psutil.Process:
    """Return what a make has started for its recipe: the shell, which becomes Python."""

    def found():
        with suppress(psutil.Error):  # a make asks a shell for its own number first
            return [one for one in psutil.Process(make).children() if "--from-make" in " ".join(one.cmdline())]

    return wait_for(found, "recipe")[0]


def end(process, number: int, seconds: float = 10.0) -> str:
    """Send make a signal, see that it and all below it end, and return what was said."""
    assert process.poll() is None, "it has ended by itself"
    below = psutil.Process(process.pid).children(recursive=True)
    process.send_signal(number)
    _, alive = psutil.wait_procs([psutil.Process(process.pid), *below], timeout=seconds)
    left = [one.cmdline() for one in alive]
    for one in alive:
        one.kill()
    errors = process.communicate()[1]
    assert not left, f"{left}\n{errors}"
    return errors


@needs_make
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGHUP])
@pytest.mark.parametrize("seconds", [0.02, 0.1, 0.3, 0.9])
def test_a_make_that_ends_in_its_first_second_takes_python_with_it(make, number, seconds):
    process = make("slow_imports:main")
    python = recipe(process.pid)
    time.sleep(seconds)
    end(process, number)
    assert not python.is_running()


@needs_make
def test_a_benchmark_ends_with_its_make_while_it_imports_torch(make):
    process = make("", program="import replicate.benchmarks, slow_imports")
    recipe(process.pid)
    time.sleep(0.9)
    assert end(process, signal.SIGKILL) == LINE


@needs_make
def test_a_make_that_was_gone_before_python_started_takes_it_along(make, tmp_path):
    process = make("slow_imports:main", before="sleep 1; ")
    recipe(process.pid)
    assert end(process, signal.SIGKILL) == LINE


@needs_make
@pytest.mark.skipif(sys.platform != "linux", reason="needs Linux' subreapers")
def test_a_make_whose_orphans_stay_in_its_session_takes_python_along(make):
    reaper = make("slow_imports:main", before="sleep 1; ", below=(sys.executable, "-c", REAPER))
    (its,) = wait_for(lambda: psutil.Process(reaper.pid).children(), "make")
    recipe(its.pid)
    its.kill()
    assert reaper.communicate(timeout=30)[1] == LINE


@needs_make
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGHUP])
def test_a_make_that_ends_later_takes_the_run_and_its_workers_with_it(make, cache, number):
    process = make(TOYS)
    wait_for(lambda: processes_of(cache, STAGE), "stage")
    assert LINE in end(process, number)


def test_a_run_outlives_the_shell_that_has_started_it(cache, monkeypatch):
    monkeypatch.setenv("MAKELEVEL", "1")  # as in a shell that a make has started
    script = f"nohup {sys.executable} -c '{DOOR}' toy_stages:main 0.1 5 2 & wait"
    process = launch(["bash", "-c", script], cache)
    wait_for(lambda: processes_of(cache, STAGE), "stage")
    process.kill()
    out, errors = process.communicate(timeout=60)  # until the last of them has closed its end
    assert "made 5 of 5 artefacts" in out, errors
