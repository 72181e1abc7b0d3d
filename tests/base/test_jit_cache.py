"""Kept machine code is that of the sources as they are."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from replicate.base import jit_cache
from replicate.base.paths import ROOT

ANSWER = "from replicate.geometry.kernel import answer; print(answer())"
KERNEL = """
from numba import njit

from replicate.base.jit_cache import KEEP_CODE
from replicate.geometry.number import NUMBER


@njit(cache=KEEP_CODE)
def answer():
    return NUMBER
"""


def project(folder: Path, number: int) -> Path:
    """Return a project of two modules: a kernel, and a number that it takes from the other."""
    package = folder / "replicate"
    (package / "geometry").mkdir(parents=True, exist_ok=True)
    (folder / "data_recipes").mkdir(exist_ok=True)
    if not (package / "engine").exists():
        shutil.copytree(ROOT / "replicate" / "engine", package / "engine", ignore=shutil.ignore_patterns("__pycache__"))
    (package / "geometry" / "number.py").write_text(f"NUMBER = {number}\n")
    (package / "geometry" / "kernel.py").write_text(KERNEL)
    return folder


def ask(folder: Path, cache: Path) -> str:
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": "", "PYTHONDONTWRITEBYTECODE": "1"}
    process = subprocess.run(
        [sys.executable, "-c", ANSWER], cwd=folder, env=environment, capture_output=True, text=True, check=True
    )
    return process.stdout.strip()


def test_a_kernel_is_compiled_anew_when_a_module_has_changed_that_it_takes_a_number_from(tmp_path):
    cache, folder = tmp_path / "kept", project(tmp_path / "project", 41)
    times = (folder / "replicate" / "geometry" / "kernel.py").stat()
    assert ask(folder, cache) == "41"
    project(folder, 42)
    os.utime(folder / "replicate" / "geometry" / "kernel.py", ns=(times.st_atime_ns, times.st_mtime_ns))
    assert ask(folder, cache) == "42"
    assert len(list(cache.glob("kernels-*"))) == 2 and list(cache.rglob("*.nbc")), "nothing was kept"


def test_processes_of_one_state_share_a_folder_whoever_starts_them(tmp_path):
    one = jit_cache.folder_of(str(tmp_path), "a" * 64)
    assert Path(one).parent == tmp_path
    assert jit_cache.folder_of(one, "a" * 64) == one
    assert Path(jit_cache.folder_of(one, "b" * 64)).parent == tmp_path


def test_all_kernels_are_known():
    asking = {file for file in (ROOT / "replicate").rglob("*.py") if "import KEEP_CODE" in file.read_text()}
    names = {".".join(file.relative_to(ROOT).with_suffix("").parts) for file in asking}
    assert names <= set(jit_cache.kernels()) and "replicate.kernels.pixel_kernel" in jit_cache.kernels()
