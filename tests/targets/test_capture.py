"""`make capture` and `make figure12` on the tiny rig: whole, repeatable, and with a sentence for a bad recording."""

import json
import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest
import rigs
from PIL import Image
from refusal import refusal

from data_recipes.catalogue import FACE_LANDMARKS, performance
from replicate import __main__ as cli
from replicate.base.progress import progress
from replicate.capture.capture_config import CaptureConfig
from replicate.capture.landmark_file import write_landmarks
from replicate.config import resolve
from replicate.engine.stage import in_order, input_names
from replicate.inverse.control_points import default_section as inverse_section
from replicate.inverse.ik_network import Truth
from replicate.methods.method_registry import sections
from replicate.methods.plan import Plan
from replicate.report.results import find, read_results
from replicate.targets import capture, figure12
from replicate.targets.figure12 import rows as figure12_rows
from replicate.targets.figure12.rows import METRICS, capture_rows, drivers, fit_ridge, metric_name
from replicate.targets.figure12.shown import answer12, tables12

SECTIONS = sections("quick") | {"inverse": inverse_section("quick"), "capture": CaptureConfig()}

NUMBERS = """
[samples]
count = 300
validation = 8
[coarse]
map_size = 16
[coarse.training]
steps = 80
peak_rate = 0.01
[refinement]
map_size = 32
poses = 30
[refinement.training]
steps = 10
[regional]
regions = 2
components = 12
hidden = [32]
[regional.training]
steps = 80
[inverse]
hidden = [48, 48]
[inverse.training]
steps = 250
peak_rate = 0.004
[capture]
actor = "tiny"
noises_mm = [2.0, 0.0]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A cache, results and a configuration of their own, in which `figure12` and `capture` have been run."""
    place = tmp_path_factory.mktemp("capture")
    (place / "numbers.toml").write_text(NUMBERS)
    rig = rigs.landmark_rig("tiny")
    places = rig(performance(rig)[40:56])[:, rig.control_points, :2].astype(float)
    places[0] = rig.mesh.neutral[rig.control_points, :2]
    places[8, 5] = np.nan
    write_landmarks(place / "actor.csv", np.concatenate([places[:1]] * 3 + [places[1:]]), tuple(FACE_LANDMARKS), "mm")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("REPLICATE_CACHE", str(place / "cache"))
        rigs.put_into(place / "cache")
        patch.setenv("REPLICATE_RESULTS", str(place / "results"))
        assert run("figure12", place) == 0
        assert run("capture", place, "--landmarks", str(place / "actor.csv")) == 0
        yield place


def run(target, place, *more):
    """Run a target on the tiny rig and return the exit code."""
    common = ["--profile", "quick", "--characters", "tiny", "--jobs", "2", "--config", str(place / "numbers.toml")]
    return cli.main([target, *common, *more])


def figure_stage():
    """Return the stage of the figure as the fixture has run it."""
    config = resolve("tiny", "quick", tomllib.loads(NUMBERS), None, SECTIONS, seed=0, device="cpu")
    return figure12.stages(Plan(config))[-1]


def test_every_driver_is_measured_at_every_noise(folder):
    rows = read_results(folder / "results/quick/figure12.csv")
    for method in ("refined", "landmark_ridge"):
        for noise in (0, 2):
            for smoothed in (False, True):
                for metric in METRICS:
                    row = find(rows, "figure12", "tiny", method, metric_name(metric, "tiny", noise, smoothed))
                    assert row is not None and np.isfinite(row.value) and row.value >= 0, (method, metric, noise)
    assert {row.method for row in rows} == {"refined", "landmark_ridge", "neutral", "scale"}


def test_another_actor_of_another_size_drives_the_same_face(folder, tmp_path):
    stage = figure_stage()
    inputs = {name: folder / "cache" / one.identifier for name, one in input_names(stage.inputs).items()}
    own = figure12_rows.load(inputs, "tiny")
    (tmp_path / "other").mkdir()
    arrays = {**vars(own), "landmarks": 1.6 * own.landmarks + np.float32([300, -40, 0])}
    np.savez(tmp_path / "other" / figure12_rows.ARRAYS, **arrays)
    section = replace(stage.config.section, noises_mm=(0.0,), smoothing_frames=1)
    trial = replace(stage.config, actors=("tiny", "other"), section=section)
    every = drivers(trial, inputs)[:1]
    rows = capture_rows(trial, inputs | {"performance-other": tmp_path / "other"}, every, progress)
    values = {row.metric: row.value for row in rows}
    assert values["scale[other]"] == pytest.approx(1 / 1.6, rel=1e-4) and values["scale[tiny]"] == pytest.approx(1)
    for metric in ("landmark_error_mean", "jitter", "outside_limits"):
        same = (values[metric_name(metric, actor, 0.0, False)] for actor in ("tiny", "other"))
        assert next(same) == pytest.approx(next(same), rel=0.02, abs=1e-3), metric
    assert metric_name("vertex_error_mean", "other", 0.0, False) not in values
    own_table, other_table = tables12(rows)
    assert "driven by the landmarks of the other" in other_table.title
    assert "Parameters, in % of their ranges" not in [line[0] for line in other_table.body if line]
    assert "Parameters, in % of their ranges" in [line[0] for line in own_table.body if line]


def test_landmarks_bring_the_face_nearer_than_the_neutral_pose_and_noise_makes_it_tremble(folder):
    rows = read_results(folder / "results/quick/figure12.csv")

    def value(metric, method="refined", noise=0.0, smoothed=False):
        return find(rows, "figure12", "tiny", method, metric_name(metric, "tiny", noise, smoothed)).value

    assert value("landmark_error_mean") < 0.75 * value("landmark_error_mean", "neutral")
    assert value("vertex_error_mean") < value("vertex_error_mean", "neutral")
    assert value("landmark_error_mean", noise=2.0) > value("landmark_error_mean")
    assert value("jitter", noise=2.0) > 2 * value("jitter")
    assert value("jitter", noise=2.0, smoothed=True) < 0.6 * value("jitter", noise=2.0)
    assert value("landmark_error_mean", noise=2.0, smoothed=True) < value("landmark_error_mean", noise=2.0)


def test_the_figures_and_the_page_are_there_with_their_words(folder):
    for name in ("figure12_tiny", "figure12_tiny_noise"):
        words = json.loads((folder / f"results/quick/{name}.json").read_text())
        assert Image.open(folder / f"results/quick/{name}.png").text["Description"] == words["alt"]
    assert "0.0 mm" not in json.loads((folder / "results/quick/figure12_tiny.json").read_text())["alt"]
    page = (folder / "results/quick/figure12.ipynb").read_text()
    assert (
        "IK networks bring landmarks of its own, with 0 mm of noise" in page
        and len(re.findall(r'"image/(png|jpeg)": "', page)) == 2
    )


def test_table_and_answer_show_the_rows(folder):
    rows = read_results(folder / "results/quick/figure12.csv")
    (own,) = tables12(rows)
    assert own.title == "Figure 12: tiny, driven by its own landmarks" and own.headers[0][1:] == ("0 mm", "2 mm")
    labels = [line[0] for line in own.body if line]
    assert "IK networks, refined, smoothed" in labels and "neutral pose, smoothed" not in labels
    (sentence,) = answer12([replace(row, value=4.321) if row.method == "neutral" else row for row in rows])
    assert sentence.startswith("**On tiny**") and "neutral pose 4.32 mm" in sentence


def test_a_recording_becomes_an_animation_a_strip_and_parameters(folder, capfd):
    out = folder / "results/capture"
    assert {file.name.removeprefix("tiny_actor") for file in out.iterdir() if not file.name.startswith(".")} == {
        ".glb", ".json", ".png", "_parameters.csv"
    }  # fmt: skip
    tree = json.loads((out / "tiny_actor.glb").read_bytes()[20:].partition(b"\0")[0].rpartition(b"}")[0] + b"}")
    assert len(tree["animations"]) == 1
    caption = json.loads((out / "tiny_actor.json").read_text())["caption"]
    assert "1 places of which are interpolated" in caption and "smoothed over 7 frames" in caption
    assert cli.main(["export", "--characters", "tiny", "--params", str(out / "tiny_actor_parameters.csv")]) == 0
    assert "18 frames at 24 a second" in capfd.readouterr().out


def test_running_again_does_nothing_and_another_window_drives_anew(folder, capfd):
    assert run("capture", folder, "--landmarks", str(folder / "actor.csv")) == 0
    assert "nothing to do" in capfd.readouterr().out
    keys = []
    for window in (7, 1):
        overrides = {"capture": {"smoothing_frames": window}}
        config = resolve("tiny", "quick", overrides, None, SECTIONS, seed=0, device="cpu")
        stages = in_order(capture.stages(Plan(config), landmarks=folder / "actor.csv"))
        keys.append({stage.title: stage.key for stage in stages})
    assert {title for title in keys[0] if keys[0][title] != keys[1][title]} == {"capture-tiny"}


def test_a_bad_recording_or_none_gets_a_sentence_before_anything_is_trained(tmp_path, cache, capsys):
    arguments = ("capture", "--profile", "quick", "--characters", "tiny")
    assert "LANDMARKS=file.csv" in refusal(capsys, *arguments)
    (tmp_path / "bad.csv").write_text("frame,landmark,x_mm,y_mm\n0,ear,1,2\n")
    sentence = refusal(capsys, *arguments, "--landmarks", str(tmp_path / "bad.csv"))
    assert "bad.csv, line 2: there is no landmark 'ear'" in sentence
    write_landmarks(tmp_path / "short.csv", np.ones((3, 54, 2)), tuple(FACE_LANDMARKS), "mm")
    sentence = refusal(capsys, *arguments, "--landmarks", str(tmp_path / "short.csv"))
    assert "short.csv: the recording: expected more than 3 frames, got 3" in sentence
    write_landmarks(tmp_path / "point.csv", np.ones((4, 54, 2)), tuple(FACE_LANDMARKS), "mm")
    sentence = refusal(capsys, *arguments, "--landmarks", str(tmp_path / "point.csv"))
    assert "point.csv: all landmarks of the neutral frames are in one place" in sentence
    assert not cache.exists()


def test_the_ridge_finds_a_linear_face_again():
    rng = np.random.default_rng(0)
    slopes, rest = rng.normal(size=(5, 8, 3)), rng.normal(size=(8, 3))
    params, held_out = rng.normal(size=(400, 5)), rng.normal(size=(40, 5))
    truth = Truth(*((rest + np.tensordot(p, slopes, 1)).astype(np.float32) for p in (params, held_out)))
    ranges = np.array([1.0, 2.0, 0.5, 4.0, 1.0])
    ridge = fit_ridge(truth, params, held_out, rest, ranges, 0.0, rng)
    np.testing.assert_allclose(ridge.solve(truth.validation), held_out, atol=0.01)
    noisy = fit_ridge(truth, params, held_out, rest, ranges, 2.0, rng)
    assert np.abs(noisy.weights).sum() < 0.9 * np.abs(ridge.weights).sum()
