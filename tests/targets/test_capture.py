"""`make capture` and `make figure12` on the tiny rig: whole, repeatable, and with a sentence for a bad recording."""

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from refusal import refusal

from data_recipes.catalogue import FACE_LANDMARKS, build_rig, character_parts, performance, with_face_landmarks
from replicate import __main__ as cli
from replicate.capture.landmark_file import write_landmarks
from replicate.report.results import find, read_results
from replicate.targets.figure12.capture_rows import metric_name
from replicate.targets.figure12.capture_tables import answer12, tables12
from replicate.targets.figure12.landmark_ridge import fit_ridge

NUMBERS = """
[samples]
count = 300
validation = 8
[coarse]
map_size = 16
[coarse.training]
steps = 120
peak_rate = 0.01
[refinement]
map_size = 32
poses = 30
[refinement.training]
steps = 10
[rigid]
poses = 20
[inverse]
hidden = [48, 48]
[inverse.training]
steps = 250
peak_rate = 0.004
[capture]
actor = "tiny@4"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A cache, results and a configuration of their own, in which `figure12` and `capture` have been run."""
    place = tmp_path_factory.mktemp("capture")
    (place / "numbers.toml").write_text(NUMBERS)
    rig = with_face_landmarks(build_rig("tiny"), character_parts("tiny")[0])
    places = rig(performance(rig)[40:70])[:, rig.control_points, :2].astype(float)
    places[0] = rig.mesh.neutral[rig.control_points, :2]
    places[10, 5] = np.nan
    write_landmarks(place / "actor.csv", np.concatenate([places[:1]] * 3 + [places[1:]]), tuple(FACE_LANDMARKS), "mm")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("REPLICATE_CACHE", str(place / "cache"))
        patch.setenv("REPLICATE_RESULTS", str(place / "results"))
        assert run("figure12", place) == 0
        assert run("capture", place, "--landmarks", str(place / "actor.csv")) == 0
        yield place


def run(target, place, *more):
    """Run a target on the tiny rig and return the exit code."""
    common = ["--profile", "quick", "--characters", "tiny", "--jobs", "1", "--config", str(place / "numbers.toml")]
    return cli.main([target, *common, *more])


def test_every_driver_is_measured_at_every_noise(folder):
    rows = read_results(folder / "results/quick/figure12.csv")
    for method in ("refined", "landmark_ridge"):
        for actor in ("tiny", "tiny@4"):
            for noise in (0, 0.25, 0.5, 1, 2):
                for smoothed in (False, True):
                    own = ("parameter_error_mean", "vertex_error_mean") if actor == "tiny" else ()
                    for metric in ("landmark_error_mean", "jitter", "outside_limits", *own):
                        name = metric_name(metric, actor, noise, smoothed)
                        row = find(rows, "figure12", "tiny", method, name)
                        assert row is not None and np.isfinite(row.value) and row.value >= 0, name
    assert {row.method for row in rows} == {"refined", "landmark_ridge", "neutral", "scale"}


def test_landmarks_bring_the_face_nearer_than_the_neutral_pose_and_noise_makes_it_tremble(folder):
    rows = read_results(folder / "results/quick/figure12.csv")

    def value(metric, method="refined", noise=0.0, smoothed=False):
        return find(rows, "figure12", "tiny", method, metric_name(metric, "tiny", noise, smoothed)).value

    assert value("landmark_error_mean") < 0.6 * value("landmark_error_mean", "neutral")
    assert value("vertex_error_mean") < value("vertex_error_mean", "neutral")
    assert value("landmark_error_mean", noise=2.0) > value("landmark_error_mean")
    assert value("jitter", noise=2.0) > 2 * value("jitter")
    assert value("jitter", noise=2.0, smoothed=True) < 0.6 * value("jitter", noise=2.0)
    assert value("landmark_error_mean", noise=2.0, smoothed=True) < value("landmark_error_mean", noise=2.0)


def test_the_figures_and_the_page_are_there_with_their_words(folder):
    for name in ("figure12_tiny", "figure12_tiny_noise"):
        words = json.loads((folder / f"results/quick/{name}.json").read_text())
        assert Image.open(folder / f"results/quick/{name}.png").text["Description"] == words["alt"]
    assert "tiny@4" in json.loads((folder / "results/quick/figure12_tiny.json").read_text())["caption"]
    page = (folder / "results/quick/figure12.ipynb").read_text()
    assert "IK networks bring exact landmarks" in page and page.count('"image/png"') == 2


def test_tables_and_answer_show_the_rows(folder):
    rows = read_results(folder / "results/quick/figure12.csv")
    own, other = tables12(rows)
    assert own.title == "Figure 12: tiny, driven by its own landmarks" and "tiny@4" in other.title
    labels = [line[0] for line in own.body if line]
    assert "IK networks, refined, smoothed" in labels and "neutral pose, smoothed" not in labels
    assert "Parameters, in shares of their ranges" not in [line[0] for line in other.body if line]
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
    assert "32 frames at 24 a second" in capfd.readouterr().out


def test_running_again_does_nothing_and_another_window_drives_anew(folder, capfd):
    landmarks = ("--landmarks", str(folder / "actor.csv"))
    assert run("capture", folder, *landmarks) == 0 and "nothing to do" in capfd.readouterr().out
    before = (folder / "results/capture/tiny_actor_parameters.csv").read_text()
    text = NUMBERS + "smoothing_frames = 1\n"
    (folder / "numbers.toml").write_text(text)
    try:
        assert run("capture", folder, *landmarks) == 0
    finally:
        (folder / "numbers.toml").write_text(NUMBERS)
    out = capfd.readouterr().out
    assert "made 1 of" in out and "not smoothed" in out
    assert (folder / "results/capture/tiny_actor_parameters.csv").read_text() != before


def test_a_bad_recording_or_none_gets_a_sentence_before_anything_is_trained(tmp_path, cache, capsys):
    arguments = ("capture", "--profile", "quick", "--characters", "tiny")
    assert "LANDMARKS=file.csv" in refusal(capsys, *arguments)
    (tmp_path / "bad.csv").write_text("frame,landmark,x_mm,y_mm\n0,ear,1,2\n")
    sentence = refusal(capsys, *arguments, "--landmarks", str(tmp_path / "bad.csv"))
    assert "bad.csv, line 2: there is no landmark 'ear'" in sentence
    write_landmarks(tmp_path / "short.csv", np.ones((3, 54, 2)), tuple(FACE_LANDMARKS), "mm")
    sentence = refusal(capsys, *arguments, "--landmarks", str(tmp_path / "short.csv"))
    assert "short.csv: the recording has 3 frames, where more than 3 are needed" in sentence
    assert not cache.exists()


def test_the_ridge_finds_a_linear_face_again():
    from replicate.inverse.ik_training import Truth

    rng = np.random.default_rng(0)
    slopes, rest = rng.normal(size=(5, 8, 3)), rng.normal(size=(8, 3))
    params, held_out = rng.normal(size=(400, 5)), rng.normal(size=(40, 5))
    truth = Truth(*((rest + np.tensordot(p, slopes, 1)).astype(np.float32) for p in (params, held_out)))
    ranges = np.array([1.0, 2.0, 0.5, 4.0, 1.0])
    ridge = fit_ridge(truth, params, held_out, rest, ranges, 0.0, rng)
    np.testing.assert_allclose(ridge.solve(truth.validation), held_out, atol=0.01)
    noisy = fit_ridge(truth, params, held_out, rest, ranges, 2.0, rng)
    assert np.abs(noisy.weights).sum() < 0.9 * np.abs(ridge.weights).sum()
