"""Workers that are forks: they find libraries loaded, die with their nursery, and are not forked beside a thread."""

import json
import os
import sys
import threading
from contextlib import suppress

import psutil
import pytest
from toy_runs import own_children
from toy_stages import ToyConfig

from replicate.base.exceptions import RunError
from replicate.engine import workers
from replicate.engine.scheduler import run
from replicate.engine.stage import Stage
from replicate.engine.workers import Nursery, worker_environment

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="workers are forks on Linux alone")

STAGES = """
import gc, json, os, sys, time

def first(context):
    import numba
    (context.out / "facts.json").write_text(json.dumps({"pid": os.getpid()}))

def second(context):
    facts = {"pid": os.getpid(), "loaded": "numba" in sys.modules, "torch": "torch" in sys.modules,
             "group": os.getpgid(0), "every": gc.get_threshold()[0]}
    (context.out / "facts.json").write_text(json.dumps(facts))

def sleep(context):
    time.sleep(60)

def environment(context):
    (context.out / "facts.json").write_text(json.dumps([os.environ.get("HERE"), os.environ.get("GONE")]))
"""


@pytest.fixture
def stages(tmp_path, monkeypatch):
    (tmp_path / "forked.py").write_text(STAGES)
    monkeypatch.syspath_prepend(tmp_path)
    first = Stage("first", "forked:first", ToyConfig())
    return first, Stage("second", "forked:second", ToyConfig(), (first,)), Stage("sleep", "forked:sleep", ToyConfig())


def test_a_stage_finds_loaded_what_an_earlier_one_has_imported_and_is_a_process_of_its_own(cache, stages):
    second = stages[1]
    folders = run([second])
    one, two = (json.loads((folders[title] / "facts.json").read_text()) for title in ("first", "second"))
    assert two["loaded"] and not two["torch"]
    assert two["every"] == 20_000, "cycles of objects are looked for less often than Python does by itself"
    assert len({one["pid"], two["pid"], os.getpid()}) == 3 and two["group"] == two["pid"]
    assert not own_children()


def test_a_killed_nursery_ends_the_run_with_a_sentence(cache, stages):
    ended = threading.Event()

    def kill():
        while not ended.wait(0.02):  # not once: the first may be an earlier test's nursery, whose last worker is ending
            with suppress(psutil.NoSuchProcess):  # a child that ends while it is looked at
                for child in own_children():
                    if child.children():
                        child.kill()

    threading.Thread(target=kill, daemon=True).start()
    try:
        with pytest.raises(RunError, match="stage sleep was killed by SIGKILL"):
            run([stages[2]])
    finally:
        ended.set()
    assert not own_children()


def test_beside_a_thread_nothing_is_forked_nor_by_a_nursery_that_is_gone(tmp_path):
    (tmp_path / "starts_a_thread.py").write_text(
        "import threading, time\nthreading.Thread(target=time.sleep, args=(60,)).start()"
    )
    path = os.pathsep.join([str(tmp_path), *sys.path])
    nursery = Nursery({**os.environ, "PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1"})
    worker = nursery.start(["no_such_library"])
    assert worker is not None
    worker.stdin.close()  # who asked is gone: it ends
    assert worker.wait() == worker.returncode == 0
    assert nursery.start(["starts_a_thread"]) is None
    own_children()[0].kill()
    assert nursery.start([]) is None
    nursery.close()


def test_a_worker_of_a_process_with_its_flags_has_the_same_and_so_the_same_compiled_code(monkeypatch):
    orders = {"cache": "here", "threads": 1}
    monkeypatch.delenv("XLA_FLAGS", raising=False)
    assert worker_environment(orders)["XLA_FLAGS"] == "--xla_cpu_multi_thread_eigen=false"
    for flags in ("--xla_cpu_multi_thread_eigen=false --xla_a=1", "--xla_a=1 --xla_cpu_multi_thread_eigen=false"):
        monkeypatch.setenv("XLA_FLAGS", flags)
        assert sorted(worker_environment(orders)["XLA_FLAGS"].split()) == sorted(flags.split())
        several = worker_environment(orders | {"threads": 4})["XLA_FLAGS"].split()
        assert several == ["--xla_a=1", "--xla_cpu_multi_thread_eigen=true"]


def test_a_worker_may_have_another_environment_than_its_nursery(cache, stages, monkeypatch):
    class Other(Nursery):
        def __init__(self, environment):
            super().__init__({**environment, "GONE": "before"})
            self.environment = environment

        def start(self, libraries):
            return super().start(libraries, {**self.environment, "HERE": "now"})

    monkeypatch.setattr(workers, "Nursery", Other)
    (folder,) = run([Stage("told", "forked:environment", ToyConfig())]).values()
    assert json.loads((folder / "facts.json").read_text()) == ["now", None]
