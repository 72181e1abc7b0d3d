"""REPRODUCING's method from outside, exactly as it stands there: rows, heatmaps, times, no other change."""

import os
import re
import subprocess
import sys

import numpy as np
import pytest
import rigs
from outside import bring  # noqa: F401, a fixture

from replicate import __main__ as cli
from replicate.base.paths import ROOT
from replicate.methods.method_registry import VARIABLE, choose, method_named
from replicate.report.pose_record import load_pose
from replicate.report.results import find, read_results
from replicate.targets.figure10 import figure10

FEW = "[samples]\ncount = 300\nvalidation = 16\n[evaluation]\ntest_poses = 20\n"


@pytest.fixture(scope="module")
def example():
    found = re.search(
        r"<!-- nearest\.py -->\n```python\n(.*?)```", (ROOT / "REPRODUCING.md").read_text("utf-8"), re.DOTALL
    )
    return found[1]


def test_the_readmes_method_stands_for_the_neutral_pose(runs):
    rows = read_results(runs / "results" / "quick" / "table2.csv")
    for metric in ("vertex_error_mean", "normal_error_mean"):
        assert (
            find(rows, "table2", "tiny", "mine", metric).value == find(rows, "table2", "tiny", "neutral", metric).value
        )


@pytest.fixture(scope="module")
def runs(tmp_path_factory, example):
    """Table 2 on tiny with both texts' methods and the neutral pose, then times; returns the results' folder."""
    folder = tmp_path_factory.mktemp("outside method")  # with a space in its path
    (folder / "nearest.py").write_text(example, encoding="utf-8")
    brief = re.search(r"<!-- mine\.py -->\n```python\n(.*?)```", (ROOT / "README.md").read_text("utf-8"), re.DOTALL)
    (folder / "mine.py").write_text(brief[1], encoding="utf-8")
    (folder / "few.toml").write_text(FEW)
    places = {"REPLICATE_CACHE": folder / "cache", "REPLICATE_RESULTS": folder / "results"}
    environment = os.environ | {name: str(path) for name, path in places.items()}
    rigs.put_into(folder / "cache")
    mine = f'"{folder / "nearest.py"}"'
    table = ["replicate", "table2", "--profile", "quick", "--characters", "tiny", "--config", str(folder / "few.toml")]
    times = [word.replace("table2", "table3") for word in table]
    both = [mine, f'"{folder / "mine.py"}"']
    for command in ([*table, "--numbers-only", "--methods", "neutral", *both], [*times, "--methods", mine]):
        done = subprocess.run(
            [sys.executable, "-m", *command], env=environment, cwd=ROOT, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
    return folder


def test_it_is_as_short_as_readme_says(example):
    assert len(example.splitlines()) <= 36


def test_it_gets_its_rows_and_its_size(runs):
    rows = read_results(runs / "results" / "quick" / "table2.csv")
    mine, still = (find(rows, "table2", "tiny", name, "vertex_error_mean") for name in ("nearest", "neutral"))
    assert 0 < mine.value < still.value
    assert find(rows, "table2", "tiny", "nearest", "model_size").value > 0
    assert any(row.table == "table2_segments" and row.method == "nearest" for row in rows)


def test_it_is_labelled_and_drawn_with_a_heatmap(runs, monkeypatch):
    monkeypatch.setenv(VARIABLE, "")
    monkeypatch.syspath_prepend(str(runs))
    choose([str(runs / "nearest.py")])
    assert method_named("nearest").label == "Nearest pose"
    record = load_pose(runs / "results" / "quick" / "table2_tiny_pose.npz")
    assert np.abs(record.vertices["nearest"] - record.neutral).max() > 1
    _, words = figure10(record, across=24)
    assert "Nearest pose" in words.alt


def test_it_is_timed(runs):
    rows = read_results(runs / "results" / "quick" / "table3.csv")
    for name in ("nearest", "rig", "rig_nodes", "rigid_step"):
        p05, median, p95 = (
            find(rows, "table3", "tiny", name, f"{kind}_all_cores").value for kind in ("p05", "median", "p95")
        )
        assert 0 < p05 <= median <= p95
    assert find(rows, "table3", "tiny", "nearest", "model_size").value > 0


def test_methods_that_fail_cost_their_own_rows_alone(bring, cache, capfd, monkeypatch, tmp_path):  # noqa: F811
    monkeypatch.setenv("REPLICATE_RESULTS", str(tmp_path / "results"))
    (tmp_path / "few.toml").write_text(FEW)
    answer = "np.broadcast_to(vertices, (len(params), *vertices.shape))"
    blind = bring((answer, "np.full((len(params), *vertices.shape), np.nan)"), name="brought_blind")
    gone = bring(("    vertices = artefacts", "    raise SystemExit(0)\n    vertices = artefacts"), name="brought_gone")
    gone.write_text(gone.read_text().replace('"mine', '"gone').replace("#", "%").replace("%123", "#123"))
    line = ["table2", "--numbers-only", "--profile", "quick", "--characters", "tiny"]
    methods = ["--methods", "neutral", str(blind), str(gone)]
    assert cli.main([*line, "--config", str(tmp_path / "few.toml"), *methods]) == 1
    printed, said = capfd.readouterr()
    nan = r"method mine: expected vertices \(\d+, \d+, 3\), real and finite, got nan at \[0, 0, 0\]"
    end = r"stage errors_gone-tiny failed \(.*brought_gone\.py: load called sys\.exit\(0\), .*\); its log is .*"
    assert re.fullmatch(f"tiny has no row of gone: {end}; tiny has no row of mine: {nan}\n", said.splitlines(True)[-1])
    assert "Neutral pose" in printed and "could not be made" in printed
    rows = read_results(tmp_path / "results" / "quick" / "table2.csv")
    assert find(rows, "table2", "tiny", "neutral", "vertex_error_mean")
    assert {row.method for row in rows} == {"neutral"}
