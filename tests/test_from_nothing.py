"""Ways in where nothing is there yet: replicate.sh, a container, Binder; and how the site is published."""

import os
import re
import shutil
import subprocess

import pytest

from replicate.base.paths import ROOT

SCRIPT = (ROOT / "replicate.sh").read_text("utf-8")
DRAWING = re.search(r"for package in (.*); do", SCRIPT)[1].split()


@pytest.fixture
def machine(tmp_path):
    """A folder of the only programs that replicate.sh finds; `write` puts a shell script there."""
    for name in ("dirname", "env", "grep"):
        (tmp_path / name).symlink_to(shutil.which(name))

    def write(name, text):
        with (tmp_path / name).open("x") as file:  # never through a link to the machine's own program
            file.write(f"#!/bin/sh\n{text}\n")
        (tmp_path / name).chmod(0o755)

    write("id", "echo 0")
    return tmp_path, write


def run(folder):
    command = ["/bin/sh", str(ROOT / "replicate.sh")]
    return subprocess.run(command, env=os.environ | {"PATH": str(folder)}, capture_output=True, text=True)


def test_replicate_says_which_packages_it_lacks_where_it_can_install_none(machine):
    process = run(machine[0])
    assert process.returncode == 2 and not process.stdout
    (sentence,) = process.stderr.splitlines()
    assert sentence.startswith("replicate.sh: expected apt-get and root's rights ")
    assert sentence.endswith(f"or these packages: {' '.join(['python3', 'python3-venv', 'make', *DRAWING])}")


def test_replicate_installs_what_is_missing_and_makes_table_2(machine):
    folder, write = machine
    write("python3", "exit 0")
    write("dpkg-query", 'case "$*" in *libegl1) printf installed;; *) exit 1;; esac')
    write("apt-get", 'echo "apt-get $*"')
    write("make", 'echo "make $*"')
    process = run(folder)
    assert process.returncode == 0, process.stderr
    install = "apt-get install -qq --yes --no-install-recommends libgl1-mesa-dri"
    assert process.stdout.splitlines() == ["apt-get update -qq", install, "make table2 PROFILE=quick"]


def test_replicate_asks_a_ready_machine_for_nothing(machine):
    folder, write = machine
    write("python3", "exit 0")
    write("dpkg-query", "printf installed")
    write("make", 'echo "make $*"')
    process = run(folder)
    assert process.returncode == 0 and process.stdout == "make table2 PROFILE=quick\n" and not process.stderr


def test_all_ways_in_install_the_same_packages_of_the_system():
    container = (ROOT / "Dockerfile").read_text("utf-8").replace("\\\n", " ")
    packages = re.search(r"--no-install-recommends +(.*?) +&&", container)[1].split()
    assert sorted(packages) == sorted({"ca-certificates", "make", "python3", "python3-venv", *DRAWING})
    assert (ROOT / "binder" / "apt.txt").read_text().split() == [*DRAWING, "make"]
    assert all(f" {package}" in (ROOT / ".ci" / "run").read_text() for package in DRAWING)
    assert container.endswith('RUN make environment\nCMD ["./replicate.sh"]\n')


def test_binder_has_the_locked_packages_and_the_locked_torch_for_cpus():
    yaml = pytest.importorskip("yaml")
    (torch,) = re.findall(r"^torch==(\S+)$", (ROOT / "torch.lock").read_text(), re.MULTILINE)
    packages = yaml.safe_load((ROOT / "binder" / "environment.yml").read_text())["dependencies"]
    assert packages == ["python=3.11", "pip", f"pytorch-cpu={torch}"]
    script = ROOT / "binder" / "postBuild"
    assert "--require-hashes --no-deps -r requirements.lock\n" in script.read_text() and os.access(script, os.X_OK)
    subprocess.run(["bash", "-n", str(script)], check=True)


def test_the_site_that_is_published_is_the_one_that_make_book_builds():
    yaml = pytest.importorskip("yaml")
    (job,) = yaml.safe_load((ROOT / ".github/workflows/book.yml").read_text())["jobs"].values()
    assert [step["run"] for step in job["steps"] if "run" in step] == ["make book"]
    (folder,) = [step["with"]["path"] for step in job["steps"] if "path" in step.get("with", {})]
    assert f'ROOT / "{folder.split("/")[0]}" / "{folder.split("/")[1]}"' in (ROOT / "book" / "build.py").read_text()
    assert folder == "build/book/site"
