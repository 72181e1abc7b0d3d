"""Table 2 of tiny on Dask workers: the same CSV as on this machine alone, byte for byte."""

import importlib.util
import os
import subprocess
import sys

import pytest

from replicate.engine.paths import ROOT

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("distributed") is None, reason="CLUSTER needs Dask: pip install distributed dask-jobqueue"
)
FEW = """
[samples]
count = 300
validation = 16
[coarse.training]
steps = 60
[lbs]
samples = 60
bones = [4]
relaxed = 3
iterations = 4
[rigid]
poses = 20
[evaluation]
test_poses = 20
"""


def table2(folder, *more):
    """Run Table 2 with few steps in a cache of its own; return the CSV's bytes and what was printed."""
    config = folder.parent / "few.toml"
    config.write_text(FEW)
    places = {"REPLICATE_CACHE": folder / "cache", "REPLICATE_RESULTS": folder / "results"}
    environment = os.environ | {name: str(path) for name, path in places.items()}
    command = ["table2", "--profile", "quick", "--characters", "tiny", "--seed", "0", "1", "2", "--numbers-only"]
    command += ["--methods", "coarse", "lbs", "linear", "neutral", "--config", str(config), *more]
    done = subprocess.run(
        [sys.executable, "-m", "replicate", *command], env=environment, cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return (folder / "results" / "quick" / "table2.csv").read_bytes(), done.stdout


def test_three_seeds_on_two_dask_workers_give_the_local_csv(tmp_path):
    here, _ = table2(tmp_path / "here")
    there, printed = table2(tmp_path / "there", "--cluster", "local:2")
    assert there == here
    assert b",3," in here, "three seeds are behind a number"
    assert "made " in printed
