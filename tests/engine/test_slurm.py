"""A sweep through a real Slurm of one node: the same artefacts, and jobs that end with their run."""

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import pytest
from slurm_node import jobs, obstacle, slurm_node
from toy_runs import contents, processes_of, start, survivors, wait_for
from toy_stages import toy_graph

if reason := obstacle():
    pytest.skip(reason, allow_module_level=True)

STAGE = "replicate.engine.worker"
FILE = 'jobs = 2\ncores = 1\nmemory = "1GB"\nwalltime = "00:10:00"\ninterface = "lo"\n'


@pytest.fixture(scope="module")
def slurm():
    """The environment variables that lead to a Slurm of two cores."""
    folder = Path(tempfile.mkdtemp(prefix="replicate-slurm-"))  # short, and its parents are open: munge looks at both
    with slurm_node(folder, cores=2) as variables:
        yield variables
    shutil.rmtree(folder)
    assert survivors(folder) == []


@pytest.fixture(autouse=True)
def nothing_survives(tmp_path, slurm):
    """No process and no job that a test has started outlives it."""
    yield
    wait_for(lambda: not jobs(slurm), "end of the jobs")
    assert survivors(tmp_path) == []


@pytest.fixture
def slurm_toml(tmp_path):
    """A file that names two jobs of one core."""
    file = tmp_path / "slurm.toml"
    file.write_text(FILE)
    return file


def test_jobs_write_what_a_local_run_writes(cache, slurm, slurm_toml, tmp_path):
    assert start(tmp_path / "local", 0.1, 5, 2).wait(60) == 0
    process = start(cache, 0.1, 5, 1, slurm_toml, **slurm)
    out, errors = process.communicate(timeout=120)
    assert process.returncode == 0 and "made 5 of 5 artefacts" in out, errors
    assert contents(cache, toy_graph(0.1, 5)) == contents(tmp_path / "local", toy_graph(0.1, 5))
    assert any((cache / "slurm").iterdir()), "the jobs' own output is kept"


def test_a_job_that_slurm_ends_is_submitted_again_and_its_stage_goes_on(cache, slurm, tmp_path):
    file = tmp_path / "one.toml"
    file.write_text(FILE.replace("jobs = 2", "jobs = 1"))
    process = start(cache, 0.3, 10, 1, file, **slurm)
    wait_for(lambda: processes_of(cache, STAGE), "stage")
    [job] = jobs(slurm)
    subprocess.run(["scancel", job], env={**os.environ, **slurm}, check=True)
    wait_for(lambda: set(jobs(slurm)) - {job}, "other job", 90)
    out, errors = process.communicate(timeout=120)
    assert process.returncode == 0 and "made 5 of 5 artefacts" in out, errors


def test_the_jobs_of_a_client_that_is_killed_end_by_themselves(cache, slurm, slurm_toml):
    process = start(cache, 1.0, 100, 1, slurm_toml, **slurm)
    wait_for(lambda: processes_of(cache, STAGE), "stage")
    process.kill()
    process.communicate()
    wait_for(lambda: not jobs(slurm), "end of the jobs", 60)


def test_jobs_that_slurm_refuses_are_a_sentence(cache, slurm, slurm_toml):
    slurm_toml.write_text(FILE + 'partition = "nowhere"\n')
    sentence = start(cache, 0, 1, 1, slurm_toml, **slurm).communicate(timeout=60)[1].splitlines()[-1]
    assert "InputError: CLUSTER: Slurm refuses the jobs (" in sentence and "partition" in sentence


def test_an_interface_that_is_none_is_a_sentence(cache, slurm, slurm_toml):
    slurm_toml.write_text(FILE.replace('"lo"', '"none7"'))
    sentence = start(cache, 0, 1, 1, slurm_toml, **slurm).communicate(timeout=60)[1].splitlines()[-1]
    assert "InputError: CLUSTER: " in sentence and "none7" in sentence
