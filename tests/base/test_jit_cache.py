"""Machine code is found again by later processes, is that of the sources as they are, and is never in the way."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from replicate.base import jit_cache
from replicate.base.paths import ROOT

ASK = "from replicate.geometry.kernel import plus; import sys; number = eval(sys.argv[1])\n"
ANSWER = ASK + "print(plus(number), sum(plus.stats.cache_hits.values()))"
KERNEL = """
from numba import njit

from replicate.base.jit_cache import kept
from replicate.geometry.number import NUMBER


@kept
@njit
def plus(other):
    return NUMBER + other
"""


@pytest.fixture
def project(tmp_path):
    """A project of two modules beside the ground: a kernel, and a number that it takes from the other."""
    folder = tmp_path / "project"
    shutil.copytree(ROOT / "replicate" / "base", folder / "replicate" / "base")
    (folder / "replicate" / "geometry").mkdir()
    for package in (folder / "replicate", folder / "replicate" / "geometry"):
        (package / "__init__.py").touch()
    (folder / "replicate" / "geometry" / "kernel.py").write_text(KERNEL)
    take(folder, 40)
    return folder


def take(project: Path, number: int) -> None:
    (project / "replicate" / "geometry" / "number.py").write_text(f"NUMBER = {number}\n")


def start(project: Path, number: str = "1", program: str = ANSWER, **variables: str) -> subprocess.Popen:
    own = {"REPLICATE_CACHE": str(project.parent / "cache"), "PYTHONPATH": "", "PYTHONDONTWRITEBYTECODE": "1"}
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"} | own | variables
    command = [sys.executable, "-c", program, number]
    return subprocess.Popen(
        command, cwd=project, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def ask(project: Path, *arguments: str, **variables: str) -> tuple[str, str]:
    """Return what a process answers, with how often it found its code, and what it says beside."""
    process = start(project, *arguments, **variables)
    out, errors = process.communicate(timeout=600)
    assert process.returncode == 0, errors
    return out.strip(), errors


def codes(project: Path) -> list[Path]:
    return sorted((project.parent / "cache").glob("kernels-*/*"))


def test_a_second_process_finds_the_code_of_the_first(project):
    assert ask(project) == ("41 0", "") and ask(project) == ("41 1", "")
    (file,) = codes(project)
    assert re.fullmatch(jit_cache.FOLDER_NAME, file.parent.name) and re.fullmatch(jit_cache.FILE_NAME, file.name)


def test_code_may_have_a_folder_of_its_own(project, tmp_path):
    assert [ask(project, NUMBA_CACHE_DIR=str(tmp_path / "own"))[0] for _ in range(2)] == ["41 0", "41 1"]
    assert list((tmp_path / "own").glob("kernels-*/*.code")) and not codes(project)


def test_a_kernel_is_compiled_anew_when_a_module_has_changed_that_it_takes_a_number_from(project):
    assert ask(project)[0] == "41 0"
    take(project, 41)
    assert ask(project)[0] == "42 0" and len(codes(project)) == 2
    take(project, 40)
    assert ask(project)[0] == "41 1"


def test_code_of_a_source_that_has_changed_since_it_was_loaded_is_not_kept(project):
    edit = "from pathlib import Path; Path('replicate/geometry/number.py').write_text('NUMBER = 41')\n"
    assert ask(project, "1", ASK + edit + "print(plus(number))")[0] == "41"
    assert not codes(project) and ask(project)[0] == "42 0"


def test_code_from_outside_the_project_is_not_kept(project):
    (project / "outside.py").write_text(KERNEL)
    assert ask(project, "1", ASK.replace("replicate.geometry.kernel", "outside") + "print(plus(number))")[0] == "41"
    assert not codes(project)


def test_numbas_settings_tell_code_apart(project):
    assert ask(project)[0] == "41 0"
    assert ask(project, NUMBA_BOUNDSCHECK="1")[0] == "41 0"
    assert ask(project, NUMBA_NUM_THREADS="1")[0] == "41 1"
    assert ask(project, "1", ASK + "print(plus(number))", NUMBA_DISABLE_JIT="1")[0] == "41"


@pytest.mark.parametrize("harm", ["cut short", "a bit", "a folder"])
def test_damaged_code_is_named_and_compiled_anew(project, harm):
    assert ask(project)[0] == "41 0"
    (file,) = codes(project)
    whole = file.read_bytes()
    if harm == "a folder":
        file.unlink()
        file.mkdir()
    else:
        file.write_bytes(whole[:-100] if harm == "cut short" else whole[:-9] + bytes([whole[-9] ^ 1]) + whole[-8:])
    answer, errors = ask(project)
    assert answer == "41 0" and f"{file}: damaged" in errors
    assert harm == "a folder" or ask(project) == ("41 1", "")


FULL = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (200, 200))\n"


@pytest.mark.parametrize("what", ["no folder", "no room", "no such variable"])
def test_where_nothing_can_be_kept_a_kernel_is_compiled(project, tmp_path, what):
    (tmp_path / "file").touch()
    folder = {"no folder": tmp_path / "file" / "cache", "no such variable": tmp_path / "file"}
    variables = {"REPLICATE_CACHE": str(folder[what])} if what in folder else {}
    assert ask(project, "1", FULL * (what == "no room") + ANSWER, **variables)[0] == "41 0"
    assert not codes(project)


def test_processes_that_keep_code_of_several_signatures_at_once_find_their_own(project):
    numbers = {"2": "42", "0.5": "40.5", "2j": "(40+2j)", "True": "41", "__import__('numpy').float32(0.25)": "40.25"}
    for hits in ("0", "1"):
        processes = {number: start(project, number) for number in numbers}
        answers = {number: process.communicate(timeout=600)[0].split() for number, process in processes.items()}
        assert answers == {number: [answer, hits] for number, answer in numbers.items()}
    assert len(codes(project)) == len(numbers)


def test_all_that_kernels_load_is_part_of_their_folders_name():
    sources = jit_cache.kernel_sources()
    kernels = [file for file, text in sources.items() if b"jit_cache import kept" in text]
    names = [".".join(file.relative_to(ROOT).with_suffix("").parts) for file in kernels]
    program = f"import {', '.join(names)}, sys; print(*(getattr(m, '__file__', '') for m in [*sys.modules.values()]))"
    process = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    ours = {Path(name) for name in process.stdout.split()}
    loaded = {file for file in ours if file.is_relative_to(ROOT) and file.parts[len(ROOT.parts)] != ".venv"}
    assert len(kernels) > 10 and len(loaded) > 30
    assert loaded <= set(sources)


def test_no_kernel_has_numba_keep_its_code():
    for folder in ("replicate", "data_recipes"):
        for file in (ROOT / folder).rglob("*.py"):
            assert not re.search(r"jit\([^)]*\bcache=", file.read_text(encoding="utf-8")), f"{file} has no `kept`"
