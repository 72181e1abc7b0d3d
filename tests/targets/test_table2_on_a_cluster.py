"""Table 2 of tiny on Dask workers: the CSV of a run on this machine, byte for byte, whatever is killed meanwhile."""

import os
import subprocess
import sys
import time

import pytest
import rigs
from toy_runs import dask_workers_at_work, processes_of, survivors, wait_for

from replicate.base.paths import ROOT

METHODS = ("linear",)
FEW = """
[samples]
count = 300
validation = 16
[evaluation]
test_poses = 20
"""


@pytest.fixture(autouse=True)
def nothing_survives(tmp_path):
    """No process that a test has started outlives it."""
    yield
    assert survivors(tmp_path) == []


def start(folder, *options):
    """Start Table 2 of two seeds with few steps, in a cache of its own."""
    if not folder.exists():
        folder.mkdir()
        rigs.put_into(folder / "cache")
    config = folder / "few.toml"
    config.write_text(FEW)
    command = [sys.executable, "-m", "replicate", "table2", "--profile", "quick", "--characters", "tiny"]
    command += ["--seed", "0", "1", "--numbers-only", "--methods", *METHODS, "--config", str(config), *options]
    places = {"REPLICATE_CACHE": str(folder / "cache"), "REPLICATE_RESULTS": str(folder / "results")}
    return subprocess.Popen(
        command, cwd=ROOT, env=os.environ | places, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def table(folder, process) -> list[bytes]:
    """Return the CSV that a run writes, which must succeed."""
    _, complaints = process.communicate(timeout=600)
    assert process.returncode == 0, complaints
    lines = (folder / "results" / "quick" / "table2.csv").read_bytes().splitlines()
    return [line for line in lines if b",training,s," not in line]  # no two runs share those times


def test_a_sweep_on_dask_workers_gives_the_local_csv_though_workers_and_the_client_are_killed(tmp_path):
    local, cluster = tmp_path / "local", tmp_path / "cluster"
    expected = table(local, start(local))
    assert any(b",2," in line for line in expected), "two seeds are behind a number"
    client = start(cluster, "--cluster", "local:2")
    for _ in range(2):
        worker = wait_for(lambda: dask_workers_at_work(cluster), "Dask worker at work", 120)[0]
        worker.kill()
        time.sleep(1)
    wait_for(lambda: processes_of(cluster, "replicate.engine.worker"), "stage", 120)
    client.kill()
    client.communicate()
    assert survivors(cluster) == []
    assert table(cluster, start(cluster, "--cluster", "local:2")) == expected
