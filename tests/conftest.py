"""Shapes and types of annotated functions are checked while tests run; every test has a cache of its own."""

import atexit
import os
import shutil
import signal
import tempfile
from importlib.metadata import version

for library in ("OMP", "MKL", "OPENBLAS", "NUMEXPR", "NUMBA"):  # before any of them is loaded
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
if "PYTEST_XDIST_WORKER" not in os.environ:  # all processes of the tests share the code that one of them compiles
    folder = tempfile.mkdtemp(prefix="replicate-compiled-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    os.environ["NUMBA_CACHE_DIR"] = os.path.join(folder, "numba")
    os.environ["JAX_COMPILATION_CACHE_DIR"] = os.path.join(folder, "jax")
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
    os.environ["JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES"] = "0"
    if version("jaxlib").startswith("0.10."):  # others may not know it: rigs compile in two thirds of the time
        os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --xla_cpu_use_fusion_emitters=false".strip()

for number, handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(number) is signal.SIG_IGN:  # as under nohup: processes that tests start would ignore it too
        signal.signal(number, handler)

import psutil
import pytest
from jaxtyping import install_import_hook

import replicate.config  # loaded before the hook: it checks its values itself, with sentences that are tested
import replicate.engine.cluster.config  # noqa: F401, likewise

_hook = install_import_hook(["replicate", "data_recipes"], "typechecker.check")

LONG = (
    "test_pipeline.py",
    "test_table2_on_a_cluster.py",
    "test_dask_workers.py",
    "test_characters.py",
    "test_teen.py",
    "test_ladder.py",
    "test_dragon.py",
    "test_panels.py",
)


@pytest.hookimpl(optionalhook=True)  # as without xdist
def pytest_xdist_auto_num_workers(config):
    """Use a process more than there are processors: tests that wait for schedulers and signals leave these idle."""
    if "PYTEST_XDIST_AUTO_NUM_WORKERS" in os.environ:
        return None  # xdist reads it itself
    return 1 + (psutil.cpu_count(logical=config.option.numprocesses == "logical") or 1)


def pytest_collection_modifyitems(items):
    """Begin with the longest files, so that no process is left with one of them when the others are done."""
    places = {name: place for place, name in enumerate(LONG)}
    items.sort(key=lambda item: places.get(item.path.name, len(LONG)))


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """The folder of an empty cache."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("REPLICATE_CACHE", str(folder))
    return folder
