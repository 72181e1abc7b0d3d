"""What is installed, where from and with which command, is said in several files that must agree."""

import os
import re
import shlex
import shutil
import subprocess
import tomllib
from importlib import metadata

import pytest
from packaging.specifiers import SpecifierSet

from data_recipes import recipe_paths
from replicate.base.paths import ROOT
from replicate.cli.target_list import target_table, targets

MODULE_NAMES = {
    "websocket-client": "websocket",
    "dask-jobqueue": "dask_jobqueue",
    "myst-nb": "myst_nb",
    "pillow": "PIL",
    "pytest-xdist": "xdist",
    "scikit-learn": "sklearn",
}  # where a package is imported by another name
TEXT = {"", ".cff", ".csv", ".ipynb", ".json", ".lock", ".md", ".py", ".toml", ".yml"}


def locks():
    """Return the lines of requirements.lock that name a version, and those of torch.lock."""
    texts = [(ROOT / name).read_text() for name in ("requirements.lock", "torch.lock")]
    return [[line for line in text.splitlines() if line[0] not in "# "] for text in texts]


def locked_versions():
    return dict(re.split(" ?[;\\\\]", line)[0].split("==") for lines in locks() for line in lines)


def project():
    return tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def direct():
    """Return what the suite itself asks for: to run, for its site, to be developed, and for CLUSTER."""
    lists = [
        project()["dependencies"],
        *(project()["optional-dependencies"][extra] for extra in ("book", "cluster", "course", "dev")),
    ]
    assert all(names == sorted(names) for names in lists)
    return sorted(name.partition(";")[0] for names in lists for name in names)


def text_files():
    """Return the project's text files: what git tracks, or in an unpacked archive what is there."""
    if (ROOT / ".git").exists() and shutil.which("git"):
        command = ["git", "-C", str(ROOT), "ls-files", "-z"]
        names = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split("\0")
        files = [ROOT / name for name in names if name]
    else:
        hidden = {".venv", ".cache", "__pycache__", "runs", ".pytest_cache", ".ruff_cache"}
        files = [path for path in ROOT.rglob("*") if not hidden & set(path.relative_to(ROOT).parts)]
    return [path for path in files if path.is_file() and path.suffix in TEXT]


def make(*arguments, folder=ROOT, **variables):
    if shutil.which("make") is None:
        pytest.skip("needs make")
    outside = {
        name: value for name, value in os.environ.items() if name not in ("VIRTUAL_ENV", "CONDA_PREFIX", "MAKEFLAGS")
    }
    return subprocess.run(["make", *arguments], cwd=folder, env=outside | variables, capture_output=True, text=True)


def test_every_locked_version_is_exact_and_from_no_particular_place():
    for package, version in locked_versions().items():
        assert re.fullmatch(r"[A-Za-z0-9._-]+", package) and re.fullmatch(r"[0-9][0-9a-z.]*", version), package
        assert not package.lower().startswith(("nvidia", "cuda", "triton")), package


def test_every_locked_file_has_a_hash_but_those_of_torch():
    text = (ROOT / "requirements.lock").read_text()
    pinned, torch = locks()
    entries = re.findall(r"^\S+==.*(?: \\\n    --hash=sha256:[0-9a-f]{64})+$", text, re.MULTILINE)
    assert len(entries) == len(pinned) > 100 and [line.partition("==")[0] for line in torch] == ["torch"]
    rule = (ROOT / "Makefile").read_text().partition(".venv/installed: ")[2].partition("\n\n")[0]
    assert "--require-hashes --no-deps -r requirements.lock\n" in rule and "-r torch.lock\n" in rule


def test_every_direct_dependency_is_locked():
    names = {package.lower() for package in locked_versions()}
    assert set(direct()) <= names and len(set(direct())) == len(direct())


def test_every_locked_package_takes_the_oldest_python_that_the_project_takes():
    oldest = project()["requires-python"].removeprefix(">=")
    for package, version in locked_versions().items():
        try:
            installed = metadata.metadata(package)
        except metadata.PackageNotFoundError:  # an environment of one's own may lack what only tests need
            continue
        if installed["Version"] == version and (needs := installed.get("Requires-Python")):
            assert f"{oldest}.0" in SpecifierSet(needs), f"{package} {version} needs Python {needs}"


def test_conda_installs_the_locked_versions():
    lines = (ROOT / "environment.yml").read_text().splitlines()
    pins = dict(line.split("- ")[1].partition(";")[0].split("==") for line in lines if "==" in line)
    assert set(pins) == set(direct())
    versions = {package.lower(): version for package, version in locked_versions().items()}
    assert pins == {package: versions[package] for package in direct()}


def test_make_looks_for_every_direct_dependency_in_an_active_environment():
    text = (ROOT / "Makefile").read_text().replace("\\\n", " ")
    modules = re.search(r"^MODULES := (.*)$", text, re.MULTILINE).group(1).split()
    needed = set(direct()) - {"embreex"}  # which some machines lack, and do without
    assert set(modules) == {MODULE_NAMES.get(package, package) for package in needed}


def test_package_citation_and_changelog_are_of_one_version():
    citation, changes = ((ROOT / name).read_text(encoding="utf-8") for name in ("CITATION.cff", "CHANGELOG.md"))
    version, date = re.search(r"^## (\S+), (\d{4}-\d\d-\d\d)$", changes, re.MULTILINE).groups()
    assert project()["version"] == version and f"\nversion: {version}\n" in citation
    assert f"    value: v{version}\n" in citation and f"\ndate-released: {date}\n" in citation


def test_the_checks_of_elsewhere_are_those_that_make_does():
    yaml = pytest.importorskip("yaml")
    jobs = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text())["jobs"]
    commands = {name: [step["run"] for step in job["steps"] if "run" in step] for name, job in jobs.items()}
    assert commands["whole"][-1] == ".ci/run" and commands["fast"] == ["make test-fast"]
    assert min(jobs["whole"]["strategy"]["matrix"]["python"]) == project()["requires-python"].removeprefix(">=")
    (local,) = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"]
    rules = (ROOT / "Makefile").read_text()
    for hook in local["hooks"]:
        assert local["repo"] == "local" and hook["entry"].startswith("python -m ruff ")
        assert " ".join(hook["entry"].split()[1:4]) in rules
    assert (ROOT / ".ci/run").read_text().endswith("\nmake lint\nexec make test\n")


def test_what_counts_as_slow_is_there(pytestconfig):
    (conftest,) = (p for p in pytestconfig.pluginmanager.get_plugins() if hasattr(p, "SLOW") and hasattr(p, "LONG"))
    assert list(conftest.SLOW) == sorted(set(conftest.SLOW))
    assert all((ROOT / "tests" / name).exists() for name in conftest.SLOW)


def bare_checkout(folder):
    """Copy what make reads: its rules and the modules that say what they are about, beside a ready environment."""
    shutil.copy(ROOT / "Makefile", folder)
    for part in ("targets", "benchmarks"):
        shutil.copytree(ROOT / "replicate" / part, folder / "replicate" / part)
    (folder / ".venv").mkdir()
    for name in ("requirements.lock", "torch.lock", ".venv/installed"):
        (folder / name).write_text("")


def test_make_alone_prints_every_target_and_does_nothing(tmp_path):
    bare_checkout(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    process = make(folder=tmp_path)
    assert process.returncode == 0, process.stderr
    for name, about, _ in target_table().body:
        target = re.escape(f"{name.strip('`').removeprefix('make ')}")
        assert re.search(rf"^  {target} +{re.escape(about)}$", process.stdout, re.MULTILINE), f"{name} has no help"
    assert sorted(tmp_path.rglob("*")) == before


def test_an_old_python_is_refused_in_one_sentence(tmp_path):
    for name in ("Makefile", "requirements.lock", "torch.lock", "replicate/targets/targets.toml"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    old = tmp_path / "python3.9"
    old.write_text('#!/bin/sh\n[ "$1" = --version ] && echo "Python 3.9.1" && exit\nexit 1\n')
    old.chmod(0o755)
    process = make("environment", f"PYTHON={old}", folder=tmp_path)
    sentence = process.stderr.splitlines()[0]
    assert process.returncode != 0 and not (tmp_path / ".venv").exists()
    assert sentence.startswith("Python 3.11 or newer is needed") and "3.9.1" in sentence and "PYTHON=" in sentence


def test_variables_reach_the_command_line(tmp_path):
    bare_checkout(tmp_path)
    values = {"PROFILE": "quick", "CHARACTERS": "teen woman", "SEED": "3", "JOBS": "1", "DEVICE": "cpu"}
    output = make("-n", "table2", *(f"{name}={value}" for name, value in values.items()), folder=tmp_path).stdout
    words = shlex.split(output)
    for name, value in values.items():
        assert words[words.index(f"--{name.lower()}") + 1] == value
    assert "--config" not in words and "--split" not in words
    assert "--characters" not in make("-n", "table1", folder=tmp_path).stdout, "the target has characters of its own"
    assert "--characters" in make("-n", "table1", folder=tmp_path, CHARACTERS="tiny").stdout, "from the environment too"


def test_table1_and_figures_show_every_recipe_of_the_papers_four_unless_some_are_named(tmp_path, monkeypatch):
    for name in ("toon", "tiny", "teen"):
        (tmp_path / f"{name}.toml").write_text("")
    monkeypatch.setattr(recipe_paths, "RECIPES", tmp_path)
    for name in ("table1", "figure05", "figure07", "figure08", "rig-report", "rigs"):
        assert targets()[name].characters() == ("teen", "toon")
    assert targets()["table2"].characters() == ("teen",)


@pytest.mark.parametrize("path", text_files(), ids=lambda path: str(path.relative_to(ROOT)))
def test_tracked_files_keep_the_house_rules(path):
    text = re.sub(r'"image/(png|jpeg)": "[^"]*"', "", path.read_text(encoding="utf-8"))  # no base64
    pieces = ("TO" + "DO", "FIX" + "ME", "import pick" + "le", "allow_pick" + "le=True", "torch.lo" + "ad(")
    assert not [piece for piece in pieces if piece in text]
    hosts = ("pypi" + ".org", "python" + "hosted.org", "download.py" + "torch.org")
    assert not [host for host in hosts if host in text], "a registry is the user's choice"
    homes = re.findall(r"(?<![\w.~])/(?:home|root|Users|work)/\w+", text)
    assert not homes, f"paths of one machine: {homes}"


def test_the_type_checker_looks_at_every_module_of_a_target_that_has_a_stage():
    checked = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["basedpyright"]["include"]
    assert all((ROOT / path).exists() for path in checked) and checked == sorted(checked)
    targets = sorted((ROOT / "replicate" / "targets").rglob("*.py"))
    stages = {str(path.relative_to(ROOT)) for path in targets if "StageContext" in path.read_text(encoding="utf-8")}
    assert stages <= set(checked), f"pyproject.toml, [tool.basedpyright]: lacks {sorted(stages - set(checked))}"
