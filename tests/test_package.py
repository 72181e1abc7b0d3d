"""The two packages without a checkout around them: all their files come along, and what is optional may be absent."""

import ast
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from pathlib import Path

import pytest

from replicate.base.paths import ROOT

PACKAGES = ("replicate", "data_recipes")
IGNORED = shutil.ignore_patterns("__pycache__", "*.egg-info")
DASK = ("dask", "dask_jobqueue", "distributed")
TOOLS = ("basedpyright", "pytest", "_pytest", "xdist", "ruff", "beartype", "psutil", "sphinx", "myst_nb", "furo")


def python(*arguments, folder, program=sys.executable):
    process = subprocess.run([program, *map(str, arguments)], cwd=folder, capture_output=True, text=True)
    assert process.returncode == 0, process.stdout + process.stderr
    return process.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The project's wheel, built from a copy, since building leaves folders behind."""
    pytest.importorskip("setuptools", minversion="77")
    source, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheel")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    for name in PACKAGES:
        shutil.copytree(ROOT / name, source / name, ignore=IGNORED)
    offline = ("--no-deps", "--no-index", "--no-build-isolation", "--disable-pip-version-check")
    python("-m", "pip", "wheel", "--quiet", *offline, "--wheel-dir", out, source, folder=source)
    return next(out.glob("*.whl"))


def test_a_wheel_has_every_file_of_both_packages(wheel):
    files = {
        str(path.relative_to(ROOT))
        for name in PACKAGES
        for path in (ROOT / name).rglob("*")
        if path.is_file() and path.suffix != ".md" and path.parent.name != "__pycache__"
    }
    packed = {name for name in zipfile.ZipFile(wheel).namelist() if name.split("/")[0] in PACKAGES}
    assert packed == files and {"replicate/targets/targets.toml", "replicate/deployment/c/face.c"} < packed


def test_what_is_installed_works_in_another_folder_and_without_the_checkout(wheel, tmp_path):
    python("-m", "venv", "--without-pip", tmp_path / "venv", folder=tmp_path)
    program = tmp_path / "venv" / ("Scripts" if sys.platform == "win32" else "bin") / "python"
    site = Path(
        python("-c", "import sysconfig; print(sysconfig.get_path('purelib'))", folder=tmp_path, program=program).strip()
    )
    (site / "libraries.pth").write_text(sysconfig.get_path("purelib") + "\n")  # what is installed here: no downloads
    offline = ("--no-deps", "--no-index", "--disable-pip-version-check")
    python("-m", "pip", "--python", program, "install", "--quiet", *offline, wheel, folder=tmp_path)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    program_text = (
        "import replicate, data_recipes\n"
        "from data_recipes.head.neutral_head import build_head\n"
        "from data_recipes.recipe.reading import load_recipe\n"
        "print(replicate.__file__, data_recipes.__file__, len(build_head(load_recipe('tiny')).vertices), sep='\\n')\n"
    )
    *places, vertices = python("-c", program_text, folder=elsewhere, program=program).splitlines()
    assert all(Path(place).is_relative_to(site) for place in places) and vertices == "918"
    text = python("-m", "replicate", "--help", folder=elsewhere, program=program)
    assert re.search(r"^    table2 +Table 2: ", text, re.MULTILINE)
    assert not list(elsewhere.iterdir())


def without(absent, program):
    """Return what a program writes that finds none of some packages."""
    return python("-c", f"import sys\nsys.modules.update(dict.fromkeys({absent!r}))\n{program}", folder=ROOT)


def test_cluster_without_its_extra_is_refused_in_a_sentence_that_says_what_to_install(tmp_path):
    program = (
        "import os\nfrom replicate import __main__ as cli\n"
        f"os.environ['REPLICATE_CACHE'] = {str(tmp_path)!r}\nsys.stderr = sys.stdout\n"
        "print(cli.main(['table2', '--profile', 'quick', '--characters', 'tiny', '--cluster', 'local:2']))"
    )
    assert without(DASK, program).splitlines() == [
        "CLUSTER=local:2 needs the package distributed, of the extra `cluster`: "
        "python -m pip install distributed dask-jobqueue",
        "2",
    ]


def imported(path):
    """Return the first names of all modules that a file imports, anywhere in it."""
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module for node in nodes if isinstance(node, ast.ImportFrom) and node.module and not node.level}
    return {name.partition(".")[0] for name in names}


def test_extras_are_imported_by_what_needs_them_alone():
    dev = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]["dev"]
    assert {name.replace("pytest-xdist", "xdist") for name in dev} <= set(TOOLS)
    for path in (file for name in PACKAGES for file in (ROOT / name).rglob("*.py")):
        optional = imported(path) & {*DASK, *TOOLS}
        assert not optional or (optional <= set(DASK) and path.parent.name == "cluster"), f"{path} imports {optional}"
