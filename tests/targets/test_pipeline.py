"""The whole of Table 2 on the tiny rig, as `make table2` runs it: complete, repeatable, and not to be broken."""

import csv
import json
import os
import random
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import onnxruntime
import pytest
from glb_shapes import posed_by_shapes

from replicate.base.paths import ROOT
from replicate.methods.method_registry import choose
from replicate.report.results import find, read_results
from replicate.targets.deploy import SHAPED

NUMBERS = """
[samples]
count = 600
validation = 8
[coarse]
map_size = 16
[coarse.training]
steps = 160
peak_rate = 0.01
[refinement]
map_size = 32
poses = 60
[refinement.training]
steps = 20
[dense.training]
steps = 160
[driven.training]
steps = 20
[pca]
components = 40
basis_samples = 200
[pca.training]
steps = 20
[pca_line]
components = 40
basis_samples = 200
[pca_line.training]
steps = 20
[ridge_products]
components = 60
basis_samples = 200
[morph]
shapes = 16
hidden = [16, 16]
[morph.training]
steps = 10
[morph_best]
shapes = 16
hidden = [16, 16]
[morph_best.training]
steps = 10
[differential]
components = 40
basis_samples = 200
hidden = [32, 32]
anchor_hidden = [8, 8]
[differential.training]
steps = 20
[differential.anchor_training]
steps = 20
[differential_small]
components = 40
basis_samples = 200
hidden = [16, 16]
anchor_hidden = [8, 8]
[differential_small.training]
steps = 20
[differential_small.anchor_training]
steps = 20
[compskin]
components = 40
basis_samples = 200
steps = 20
[compskin.training]
steps = 20
[compskin_best]
components = 40
basis_samples = 200
steps = 20
[compskin_best.training]
steps = 20
[dense_compact]
samples = 200
[regional]
regions = 4
components = 24
basis_samples = 200
hidden = [32, 32]
[regional.training]
steps = 20
[regional_derivatives]
regions = 4
components = 24
basis_samples = 200
hidden = [32, 32]
derivatives = 1.0
[regional_derivatives.training]
steps = 10
[coarse_released.training]
steps = 20
[refined_released.training]
steps = 10
[dense_released.training]
steps = 20
[dense_released_narrow.training]
steps = 20
[coarse_wide]
map_size = 16
hidden = [32, 128]
channels = 5
[coarse_wide.training]
steps = 20
[refined_wide]
map_size = 32
hidden = [32, 128]
channels = 5
[refined_wide.training]
steps = 10
[coarse_longer]
map_size = 16
hidden = [32, 128]
channels = 5
[coarse_longer.training]
steps = 20
[lbs]
samples = 60
iterations = 15
refit_sweeps = 20
[evaluation]
test_poses = 60
floor_poses = 60
"""
ALL = ("--methods", "all", "--numbers-only")
SHOW = ("--methods", "coarse", "refined", "linear")  # pictures of all would take half a minute
SHOWN = {method.name: method for method in choose(["all"])}
SHORT = ("--numbers-only", "--methods", "coarse", "linear", "neutral")  # what is disturbed: a part of the rows


def start(folder: Path, extra: tuple[str, ...] = (), target: str = "table2") -> subprocess.Popen:
    """Start a target on the tiny rig with a cache and results of its own."""
    config = folder / "numbers.toml"
    folder.mkdir(parents=True, exist_ok=True)
    config.write_text(NUMBERS)
    command = [sys.executable, "-m", "replicate", target, "--profile", "quick", "--characters", "tiny"]
    places = {"REPLICATE_CACHE": str(folder / "cache"), "REPLICATE_RESULTS": str(folder / "results")}
    return subprocess.Popen(
        [*command, "--config", str(config), *extra],
        cwd=ROOT,
        env={**os.environ, **places},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(folder: Path, extra: tuple[str, ...] = (), target: str = "table2") -> tuple[str, str]:
    """Run a target to its end and return what it printed; it must succeed."""
    process = start(folder, extra, target)
    out, err = process.communicate(timeout=900)
    assert process.returncode == 0, err + out
    return out, err


def table(folder: Path) -> list[bytes]:
    """Return the lines of the table but for the times of trainings, which no two runs share."""
    lines = (folder / "results" / "quick" / "table2.csv").read_bytes().splitlines(keepends=True)
    return [line for line in lines if b",training,s," not in line]


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("undisturbed")
    printed, _ = finish(folder, ALL)
    return folder, printed


@pytest.fixture(scope="module")
def short(undisturbed, tmp_path_factory):
    """A run of some methods alone, by the artefacts of the undisturbed run; it has results of its own."""
    folder = tmp_path_factory.mktemp("short")
    (folder / "cache").symlink_to(undisturbed[0] / "cache")
    finish(folder, SHORT)
    return folder


def test_every_method_has_both_errors(undisturbed):
    rows = read_results(undisturbed[0] / "results" / "quick" / "table2.csv")
    for method in SHOWN:
        for metric, unit in (("vertex_error", "mm"), ("normal_error", "deg")):
            for statistic in ("mean", "p95", "max"):
                row = find(rows, "table2", "tiny", method, f"{metric}_{statistic}")
                assert row is not None and row.unit == unit and row.value >= 0, (method, metric, statistic)
    assert all(method.title in undisturbed[1] for method in SHOWN.values())
    assert {row.method for row in rows} == set(SHOWN)


def test_numbers_are_what_the_code_gave_when_results_were_last_committed(undisturbed):
    rows = read_results(undisturbed[0] / "results" / "quick" / "table2.csv")
    with (ROOT / "tests/targets/tiny.csv").open() as file:
        before = list(csv.DictReader(file))
    assert {line["method"] for line in before} == set(SHOWN)
    moved = []
    for line in before:
        for metric, unit in (("vertex_error_mean", "mm"), ("normal_error_mean", "degrees")):
            new, old = find(rows, "table2", "tiny", line["method"], metric).value, float(line[unit])
            if abs(new - old) > float(line["within"]) * old:  # twice what another instruction set has moved them
                moved.append(f"{line['method']} {old} → {new:.4f} {unit}")
    assert not moved, (
        f"{', '.join(moved)}: committed results of these methods would change too. If that is meant, write the new "
        "numbers into tests/targets/tiny.csv, and make the results anew or name them in results/README.md"
    )


def test_every_prediction_has_its_work_and_every_training_its_time(undisturbed):
    folder, printed = undisturbed
    rows = read_results(folder / "results" / "quick" / "table2.csv")

    def values(metric: str) -> dict[str, float]:
        return {row.method: row.value for row in rows if row.table == "table2" and row.metric == metric}

    work, times, sizes = (values(metric) for metric in ("multiplications", "training", "model_size"))
    assert set(work) == set(SHOWN) - {"attachment", "floor", "floor_refined"}
    assert set(times) == {name for name in work if name != "neutral"}
    assert set(sizes) == set(times)
    assert work["neutral"] == 0 < work["linear"] < work["squares"] < work["refined"]
    assert times["refined"] > times["coarse"] > 0, "the refinement builds on the coarse networks"
    assert sizes["dense_small"] <= sizes["refined"] and sizes["dense_compact"] <= sizes["refined"]
    assert "Size, work and training: tiny" in printed
    first = printed.splitlines()[0]
    assert "artefacts to make: about " in first, "the time is told before any work"


def test_what_is_learned_beats_the_neutral_pose_and_no_method_beats_the_truth_that_it_sees(undisturbed):
    rows = read_results(undisturbed[0] / "results" / "quick" / "table2.csv")

    def error(method: str) -> float:
        return find(rows, "table2", "tiny", method, "vertex_error_mean").value

    for method in ("coarse", "refined", "dense", "lbs16", "lbs32", "floor"):
        assert error(method) < 0.6 * error("neutral"), method
    assert error("lbs32") < error("lbs16")
    assert error("floor_refined") <= error("floor")
    assert error("floor") < error("coarse")
    assert error("attachment") < 0.1 * error("neutral")


def test_running_again_does_nothing_and_says_so(undisturbed):
    folder, _ = undisturbed
    before = {path: path.stat().st_mtime_ns for path in (folder / "cache").rglob("*") if path.is_file()}
    written = table(folder)
    printed, _ = finish(folder, ALL)
    assert "nothing to do" in printed
    after = {path: path.stat().st_mtime_ns for path in (folder / "cache").rglob("*") if path.is_file()}
    assert {path: t for path, t in after.items() if path.suffix != ".lock"} == {
        path: t for path, t in before.items() if path.suffix != ".lock"
    }
    assert table(folder) == written


def test_what_is_there_already_is_drawn_and_has_its_notebook(undisturbed, tmp_path):
    (tmp_path / "cache").symlink_to(undisturbed[0] / "cache")
    printed, _ = finish(tmp_path, SHOW)
    results = tmp_path / "results" / "quick"
    for picture in ("table2_tiny_chart", "table2_tiny_curves", "figure09_tiny", "figure10_tiny", "figure10_tiny_worst"):
        assert (results / f"{picture}.png").stat().st_size > 10_000 and (results / f"{picture}.json").is_file()
    assert (results / "table2.ipynb").is_file() and "ipynb" in printed


def test_results_name_the_run_that_made_them(undisturbed):
    folder = undisturbed[0] / "results" / "quick"
    manifest = json.loads((folder / "manifest.json").read_text())
    with open(folder / "table2.csv", newline="") as file:
        runs = {row["run"] for row in csv.DictReader(file)}
    assert runs == {manifest["characters"]["tiny"]["run"]}
    assert manifest["characters"]["tiny"]["stages"]["coarse-tiny"]["wall_s"] > 0
    assert "--profile quick" in manifest["command"]


def test_every_method_with_a_model_leaves_the_suite_and_nothing_is_trained_for_it(undisturbed):
    folder, _ = undisturbed
    printed, _ = finish(folder, ALL[:2], "deploy")
    assert "made 1 of " in printed
    names = [name for name, method in SHOWN.items() if method.model]
    models = {f"deploy_tiny_{name}{precision}.onnx" for name in names for precision in ("", "_float16")}
    files = {file.name for file in (folder / "results" / "quick").glob("deploy_*")}
    usual = models | {f"deploy_tiny.{ending}" for ending in ("c", "h", "glb", "json")}
    assert len(names) >= 10 and files == usual
    finish(folder, (*ALL[:2], "--form", "shapes"), "deploy")
    results, rng = folder / "results" / "quick", np.random.default_rng(0)
    written = {file.stem for file in results.glob("deploy_shapes_*.glb")}
    assert written == {f"deploy_shapes_tiny_{name}" for name in SHAPED}
    for name in SHAPED:
        session = onnxruntime.InferenceSession(results / f"deploy_tiny_{name}.onnx", providers=["CPUExecutionProvider"])
        params = rng.uniform(0, 1, (20, session.get_inputs()[0].shape[1])).astype(np.float32)
        found = posed_by_shapes(results / f"deploy_shapes_tiny_{name}", params)
        np.testing.assert_allclose(found, session.run(None, {"parameters": params})[0], atol=2e-3)


def test_kill_9_at_ten_random_moments_changes_no_digit(short, tmp_path):
    moments = random.Random(8)
    kills, folder = 0, tmp_path / "0"
    while kills < 10:
        process = start(folder, SHORT)
        try:
            process.communicate(timeout=moments.uniform(0.5, 5.0))
        except subprocess.TimeoutExpired:
            os.kill(process.pid, signal.SIGKILL)
            process.communicate()
            kills += 1
        else:  # it got through: the other kills hit a fresh run
            assert process.returncode == 0 and table(folder) == table(short)
            folder = tmp_path / str(kills)
    printed, _ = finish(folder, SHORT)
    assert table(folder) == table(short)
    assert "ipynb" not in printed and not list((folder / "results").rglob("*.png"))


def test_a_flipped_byte_in_any_artefact_is_named_and_remade(short):
    written = table(short)
    stages = json.loads((short / "results" / "quick" / "manifest.json").read_text())["characters"]["tiny"]["stages"]
    artefacts = [short / "cache" / f"{title}-{stage['key']}" for title, stage in stages.items()]
    assert len(artefacts) >= 10
    place = random.Random(5)
    for artefact in artefacts:
        files = sorted(path for path in artefact.rglob("*") if path.is_file() and path.stat().st_size)
        file = place.choice(files)
        data = bytearray(file.read_bytes())
        data[place.randrange(len(data))] ^= 1 << place.randrange(8)
        file.write_bytes(bytes(data))
    printed, complaints = finish(short, SHORT)
    for artefact in artefacts:
        assert artefact.name in complaints, complaints
    assert f"made {len(artefacts)} of {len(artefacts)}" in printed
    assert table(short) == written
