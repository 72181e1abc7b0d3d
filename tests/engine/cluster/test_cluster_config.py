"""CLUSTER has three forms, and what is none of them is refused with what is allowed."""

import importlib.util
import shutil

import pytest

from replicate.base.exceptions import InputError
from replicate.engine.cluster import config
from replicate.engine.cluster.config import LocalCluster, RunningCluster, SlurmCluster, read_cluster


@pytest.fixture(autouse=True)
def everything_installed(monkeypatch):
    """Whatever is asked for is there, wherever the tests run."""
    monkeypatch.setattr(importlib.util, "find_spec", lambda package: package)
    monkeypatch.setattr(shutil, "which", lambda program: program)


def test_each_form_is_read(tmp_path):
    file = tmp_path / "slurm.toml"
    file.write_text('jobs = 3\ncores = 8\ngpus = 1\nmemory = "16GB"\nwalltime = "2-00:00:00"\n')
    assert read_cluster("local:4") == LocalCluster(4)
    assert read_cluster(" tcp://node-7.example.org:8786 ") == RunningCluster("tcp://node-7.example.org:8786")
    assert read_cluster(str(file)) == SlurmCluster(3, 8, "16GB", "2-00:00:00", 1)


@pytest.mark.parametrize(
    "text", ["local", "local:", "local:x", "local:4:4", "tcp://host", "http://host:80", "host:8786", "slurm", "٤"]
)
def test_another_form_is_refused_with_those_that_are_allowed(text):
    with pytest.raises(
        InputError, match=rf"^CLUSTER: expected local:4 .*, tcp://host:8786 .* or the path of .*, got '{text}'$"
    ):
        read_cluster(text)


@pytest.mark.parametrize("text", ["local:0", "local:9999"])
def test_no_and_too_many_workers_are_refused(text):
    with pytest.raises(InputError, match=rf"^CLUSTER: expected 1 to 1024 workers, got '{text}'$"):
        read_cluster(text)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ("job = 3", "unknown key job: expected jobs, cores, memory, walltime, gpus, partition, account"),
        ("jobs = 0", "jobs: expected a whole number from 1 to 1024, got 0"),
        ("gpus = 2", "gpus: expected a whole number from 0 to 1, got 2"),
        ("cores = '8'", "cores: expected a whole number from 1 to 1024, got '8'"),
        ("memory = 'much'", "memory: expected a size such as 8GB, got 'much'"),
        ("walltime = 'long'", "walltime: expected a time such as 04:00:00 or 2-00:00:00, got 'long'"),
        ("partition = 'a; rm'", "partition: expected a name, got 'a; rm'"),
        ("jobs = ", "not a readable TOML file"),
    ],
)
def test_a_file_with_what_is_not_allowed_is_named_with_the_key(tmp_path, content, sentence):
    file = tmp_path / "slurm.toml"
    file.write_text(content + "\n")
    with pytest.raises(InputError) as refusal:
        read_cluster(str(file))
    assert str(refusal.value).startswith(f"{file}: {sentence}") and "\n" not in str(refusal.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"none\.toml: "):
        read_cluster(str(tmp_path / "none.toml"))


@pytest.mark.parametrize(
    ("text", "absent", "sentence"),
    [
        (
            "local:2",
            "distributed",
            "CLUSTER=local:2 needs the package distributed, of the extra `cluster`: python -m pip",
        ),
        (
            "local:2",
            "dask_jobqueue",
            "needs the package dask-jobqueue, of the extra `cluster`: python -m pip install dist",
        ),
        (
            "slurm.toml",
            "dask_jobqueue",
            "needs the package dask-jobqueue, of the extra `cluster`: python -m pip install ",
        ),
        ("slurm.toml", "sbatch", "needs Slurm, and there is no sbatch here: run on a machine that submits jobs"),
    ],
)
def test_what_is_not_installed_is_named(monkeypatch, text, absent, sentence):
    monkeypatch.setattr(config, "_read_slurm", lambda file: SlurmCluster())
    monkeypatch.setattr(importlib.util, "find_spec", lambda package: None if package == absent else package)
    monkeypatch.setattr(shutil, "which", lambda program: None if program == absent else program)
    with pytest.raises(InputError, match=sentence):
        read_cluster(text)
