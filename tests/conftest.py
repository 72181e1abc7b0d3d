"""Shapes and types of annotated functions are checked while tests run; every test has a cache of its own."""

import atexit
import gc
import hashlib
import os
import shutil
import signal
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path
from typing import ClassVar

import llvmlite.binding

gc.set_threshold(20_000, 10, 50)  # imports and JAX leave millions of objects that are no garbage

for library in ("OMP", "MKL", "OPENBLAS", "NUMEXPR", "NUMBA"):  # before any of them is loaded
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
KEPT_CODE = Path(__file__).parents[1] / ".pytest_cache" / "compiled"
KEPT_BYTES = 500_000_000  # code of many states of the project


def kept_code():
    """Return the folder for machine code, which the next run needn't compile again: it is named by what it was made of.

    It is this processor's, as code for another may not run here. What has grown too large is begun anew.
    """
    processor = f"{llvmlite.binding.get_host_cpu_name()} {llvmlite.binding.get_host_cpu_features().flatten()}"
    if sum(file.stat().st_size for file in KEPT_CODE.rglob("*") if file.is_file()) > KEPT_BYTES:
        shutil.rmtree(KEPT_CODE, ignore_errors=True)
    return KEPT_CODE / hashlib.sha256(processor.encode()).hexdigest()[:16]


sys.modules["rfc3987_syntax"] = None  # jsonschema would let it build a grammar of addresses, which takes 2 s
if "PYTEST_XDIST_WORKER" not in os.environ:  # what one process compiles, builds or draws, all of them share
    folder = tempfile.mkdtemp(prefix="replicate-compiled-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    os.environ["REPLICATE_TEST_RIGS"] = os.path.join(folder, "rigs")
    os.environ["REPLICATE_PICTURES"] = os.path.join(folder, "pictures")
    os.mkdir(os.environ["REPLICATE_PICTURES"])
    kept = kept_code()
    os.environ["NUMBA_CACHE_DIR"] = os.path.join(kept, "numba")
    os.environ["JAX_COMPILATION_CACHE_DIR"] = os.path.join(kept, "jax")
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
    os.environ["JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES"] = "0"
    flags = [os.environ.get("XLA_FLAGS", ""), "--xla_cpu_multi_thread_eigen=false"]  # as workers have: they share code
    if version("jaxlib").startswith("0.10."):  # others may not know it: rigs compile in two thirds of the time
        flags.append("--xla_cpu_use_fusion_emitters=false")
    os.environ["XLA_FLAGS"] = " ".join(flags).strip()

for number, handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(number) is signal.SIG_IGN:  # as under nohup: processes that tests start would ignore it too
        signal.signal(number, handler)

import psutil
import pytest
from beartype.claw import beartype_packages
from jaxtyping import install_import_hook
from typechecker import CONF

import replicate.config  # loaded before the hook: it checks its values itself, with sentences that are tested
import replicate.engine.cluster.config  # noqa: F401, likewise
from replicate.base.paths import ROOT

# Shapes cost ten times as much to check as types alone: they are where a module speaks of shapes, or where numba, which
# takes functions that are wrapped so, compiles it.
SOURCES = [path for name in ("replicate", "data_recipes") for path in sorted((ROOT / name).rglob("*.py"))]
SHAPED = [path.relative_to(ROOT) for path in SOURCES if {"jaxtyping", "numba"} & set(path.read_text("utf-8").split())]
beartype_packages(("replicate", "data_recipes"), conf=CONF)
_hook = install_import_hook([".".join(path.with_suffix("").parts) for path in SHAPED], "typechecker.check")

from replicate.engine import worker, workers

LONG = (
    "test_pipeline.py",
    "test_course.py",
    "test_table2_on_a_cluster.py",
    "test_dask_workers.py",
    "test_characters.py",
    "test_teen.py",
    "test_ladder.py",
    "test_dragon.py",
    "test_panels.py",
)

# What trains, draws, compiles much, builds whole faces, or starts a browser, a cluster or a run: `make test-fast`
# leaves it out. Files, and folders with all that is in them.
SLOW = (
    "approximation/test_influence.py",
    "approximation/test_known_samples.py",
    "approximation/test_training.py",
    "base/test_jit_cache.py",
    "base/test_signals.py",
    "baselines/skinning/test_bone_network.py",
    "baselines/skinning/test_relaxation.py",
    "baselines/skinning/test_ssdr.py",
    "benchmarks",
    "capture/test_driven_face.py",
    "capture/test_recorded_face.py",
    "course/test_course.py",
    "course/test_lesson1.py",
    "course/test_lesson3.py",
    "course/test_project.py",
    "data_recipes/deformers/test_deformers_face.py",
    "data_recipes/deformers/test_deformers_generic.py",
    "data_recipes/deformers/test_deformers_lids_and_lips.py",
    "data_recipes/deformers/test_deformers_wrinkles.py",
    "data_recipes/exporters",
    "data_recipes/head",
    "data_recipes/ict",
    "data_recipes/rigify",
    "data_recipes/sampled/test_importing.py",
    "data_recipes/shapes/test_found_landmarks.py",
    "data_recipes/test_characters.py",
    "data_recipes/test_dragon.py",
    "data_recipes/test_face_check.py",
    "data_recipes/test_face_rig.py",
    "data_recipes/test_fresh_acting.py",
    "data_recipes/test_ladder.py",
    "data_recipes/test_recipe_rig.py",
    "data_recipes/test_rig_file.py",
    "data_recipes/test_teen.py",
    "deployment",
    "drawing",
    "engine/cluster/test_dask_workers.py",
    "engine/test_cache_report.py",
    "engine/test_provenance.py",
    "engine/test_scheduler.py",
    "engine/test_slurm.py",
    "engine/test_worker_nursery.py",
    "export",
    "inference",
    "inverse/test_at_vertices.py",
    "inverse/test_ik_training.py",
    "inverse/test_rig_points.py",
    "kernels/test_gradient_kernel.py",
    "kernels/test_pixel_kernel.py",
    "kernels/test_plain_twins.py",
    "methods/test_compskin.py",
    "methods/test_dense_at_equal_size.py",
    "methods/test_differential.py",
    "methods/test_morph.py",
    "methods/test_outside_method.py",
    "methods/test_pca_line.py",
    "methods/test_prediction.py",
    "methods/test_regional.py",
    "methods/test_released.py",
    "methods/test_ridge_products.py",
    "methods/test_squares.py",
    "methods/test_wide.py",
    "methods/test_with_line.py",
    "poser",
    "regional",
    "report/test_hostile_names.py",
    "report/test_notebook_kernels.py",
    "report/test_notebook_tables.py",
    "report/test_notebooks.py",
    "report/test_publish.py",
    "report/test_publish_reference.py",
    "report/test_publish_seeds.py",
    "report/test_publish_targets.py",
    "report/test_redrawn_pictures.py",
    "rig_study",
    "targets/test_capture.py",
    "targets/test_captures_of_programs.py",
    "targets/test_check.py",
    "targets/test_deploy.py",
    "targets/test_figure01.py",
    "targets/test_figure09.py",
    "targets/test_figure10.py",
    "targets/test_figure13.py",
    "targets/test_lbs_figures.py",
    "targets/test_noise_curves.py",
    "targets/test_pipeline.py",
    "targets/test_pose_numbers.py",
    "targets/test_rig_figures.py",
    "targets/test_rig_report.py",
    "targets/test_rig_sheet.py",
    "targets/test_rig_timing.py",
    "targets/test_table2_charts.py",
    "targets/test_table2_on_a_cluster.py",
    "targets/test_trained_models.py",
    "targets/test_trainings.py",
    "test_bad_input.py",
    "test_book.py",
    "test_examples.py",
    "test_package.py",
    "timing",
    "transfer",
)


@pytest.hookimpl(optionalhook=True)  # as without xdist
def pytest_xdist_auto_num_workers(config):
    """Use a process more than there are processors: tests that wait for schedulers and signals leave these idle."""
    if "PYTEST_XDIST_AUTO_NUM_WORKERS" in os.environ:
        return None  # xdist reads it itself
    return 1 + (psutil.cpu_count(logical=config.option.numprocesses == "logical") or 1)


def pytest_collection_modifyitems(items):
    """Mark what is slow. Begin with the longest files, so that no process has one left when the others are done."""
    tests = Path(__file__).parent
    for item in items:
        place = item.path.relative_to(tests)
        if not {place.as_posix(), *(folder.as_posix() for folder in place.parents)}.isdisjoint(SLOW):
            item.add_marker(pytest.mark.slow)
    places = {name: place for place, name in enumerate(LONG)}
    items.sort(key=lambda item: places.get(item.path.name, len(LONG)))


def pytest_collection_finish():
    """Leave what has been loaded out of later searches for cycles."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def drafts(request, monkeypatch):
    """Have pictures drawn with a quarter of the rays, but where drawing itself is tested: nobody sees them."""
    if request.path.parent.name != "drawing":
        monkeypatch.setattr("replicate.drawing.render.SUPERSAMPLING", 1)


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """The folder of an empty cache."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("REPLICATE_CACHE", str(folder))
    return folder


NURSERY = workers.Nursery


class SharedNursery:
    """A nursery for the runs of all tests of this process: libraries are loaded once, not once or twice for each run.

    Where an environment differs in what libraries read when they are loaded, there is another one.
    """

    nurseries: ClassVar[dict] = {}

    def __init__(self, environment):
        own = ("REPLICATE_", "PYTEST_", "KMP_")  # the last are what torch sets when it is loaded
        self._environment = environment
        key = os.getcwd(), *sorted(item for item in environment.items() if not item[0].startswith(own))
        if key not in self.nurseries:
            self.nurseries[key] = NURSERY(environment)
            atexit.register(self.nurseries[key].close)
        self._nursery = self.nurseries[key]

    def start(self, libraries):
        return self._nursery.start({*worker.LIBRARIES, *libraries}, self._environment)

    def close(self):
        """Leave the nursery to the next run; it ends with this process."""

    @classmethod
    def close_all(cls):
        """End all nurseries."""
        while cls.nurseries:
            cls.nurseries.popitem()[1].close()


@pytest.fixture(autouse=True, scope="module")
def nursery(request):
    """Have runs share nurseries, but for the tests of the engine and of signals, which look at a run's processes."""
    folder = request.path.relative_to(Path(__file__).parent).parts[0]
    with pytest.MonkeyPatch.context() as patch:
        if folder in ("base", "engine"):
            SharedNursery.close_all()
        else:
            patch.setattr(workers, "Nursery", SharedNursery)
        yield
