"""Trainings compared: which ones, how they are shown, and what a typing mistake gets."""

import argparse
import zlib
from dataclasses import asdict, replace
from types import SimpleNamespace

import numpy as np
import pytest
from plain_rig import PlainRig

from data_recipes.rig import Clip
from replicate.approximation.metrics import Errors, new_tally
from replicate.approximation.samples import choose_poses
from replicate.benchmarks import bench_training as training
from replicate.benchmarks.bench_training import (
    BALANCED,
    RAW_ANIMATION,
    RESTART,
    axis_text,
    draws_text,
    trainings_tables,
)
from replicate.config import resolve
from replicate.report.results import Row


def test_every_method_is_tried_with_the_same_changes():
    tried = training.variants(700)
    assert [v.change for v in tried if v.method == "coarse" and not v.clips][-1] == RAW_ANIMATION
    schedules = {}
    for method, section in training.SECTIONS.items():
        configs = [resolve("tiny", "laptop", v.overrides) for v in tried if v.method == method]
        schedules[method] = [getattr(config, section).training for config in configs][: len(training.CHANGES)]
        assert [s.peak_rate for s in schedules[method]][: len(training.RATES)] == list(training.RATES)
        steps = [1400 if change in training.LONGER else 700 for change in training.CHANGES]
        assert [s.steps for s in schedules[method]] == steps
    assert schedules["coarse"] == schedules["refined"] == schedules["dense"]


def test_each_change_is_of_one_thing():
    before = asdict(resolve("tiny", "laptop", {"coarse": {"training": {"steps": 700}}}).coarse.training)
    for variant in training.variants(700):
        if variant.method == "coarse" and variant.change != RAW_ANIMATION:
            changed = asdict(resolve("tiny", "laptop", variant.overrides).coarse.training)
            differing = [name for name, value in changed.items() if value != before[name]]
            assert len(differing) == (variant.change != "peak rate 0.005") + (variant.change == RESTART), variant.change


def test_the_raw_animation_is_trained_on_as_it_is_and_validated_on_the_profiles_poses():
    choices = {v.change: v for v in training.variants(700) if v.method == "coarse" and not v.clips}
    rig = PlainRig()
    rig.clips = [Clip(f"{k}", np.random.default_rng(k).random((40, 2), dtype=np.float32)) for k in range(2)]
    parts = {}
    for change in (BALANCED, RAW_ANIMATION):
        samples = resolve("tiny", "quick", choices[change].overrides).samples
        parts[change] = choose_poses(
            rig, samples, lambda stream: np.random.default_rng([0, zlib.crc32(stream.encode())])
        )
    profile, raw = parts[BALANCED], parts[RAW_ANIMATION]
    frames = {row.tobytes() for clip in rig.clips for row in clip.values}
    assert {row.tobytes() for row in raw["training"]} <= frames and len(raw["training"]) == len(profile["training"])
    assert not {row.tobytes() for row in profile["training"]} <= frames
    for part in ("validation", "test"):
        np.testing.assert_array_equal(raw[part], profile[part])


def test_clips_are_held_out_of_the_same_three_trainings_and_nothing_else_changes():
    tried = training.variants(700)
    frames = {v.change: v for v in tried if v.method == "coarse" and not v.clips}
    clips = {v.change: v for v in tried if v.clips}
    assert set(clips) == {training.USUAL, BALANCED, RAW_ANIMATION}
    for change, variant in clips.items():
        here, there = (resolve("tiny", "laptop", v.overrides) for v in (frames[change], variant))
        assert (here.samples.split, there.samples.split) == ("frames", "clips")
        assert replace(there, samples=replace(there.samples, split="frames")) == here


def test_a_rig_without_animation_is_trained_neither_raw_nor_with_clips_held_out(monkeypatch):
    seen = []
    monkeypatch.setattr(training, "has_clips", lambda config: False)
    monkeypatch.setattr(training, "stages_of", lambda config, variant: seen.append(str(variant)) or {})
    options = argparse.Namespace(steps=700, only="coarse, raw|other clips|dense, peak", profile="quick")
    monkeypatch.setattr(training, "make_stages", lambda name, profile, stages: None)
    with pytest.raises((IndexError, KeyError)):  # no stages, no errors
        training.compare("tiny", options)
    assert seen == [f"dense, peak rate {rate:g}" for rate in training.RATES]


def test_a_training_is_one_line_of_the_table():
    def row(method, metric, unit, value, character="teen"):
        return Row("bench_training", character, method, metric, unit, value, None, 1, 64, "laptop", "bench-training")

    rows = [
        row("dense", "validation_vertex_error[0.005, 10 steps]", "mm", 0.5),
        row("coarse", "normal_error_over_floor[uniform draws]", "ratio", 1.25),
        row("coarse", "validation_normal_error[uniform draws]", "deg", 2.0),
        row("coarse", "validation_vertex_error[uniform draws]", "mm", 0.25),
    ]
    rows.append(row("coarse", "validation_vertex_error[uniform draws]", "mm", 0.75, "woman"))
    table, other = trainings_tables(rows)
    assert table.title.endswith(": teen") and other.body == (("coarse", "uniform draws", "0.75", "", "", "", ""),)
    assert table.body == (
        ("coarse", "uniform draws", "0.25", "2.00", "1.25", "", ""),
        None,
        ("dense", "0.005, 10 steps", "0.50", "", "", "", ""),
    )
    assert len(table.notes) == 1
    (table,) = trainings_tables([*rows[:4], row("coarse", "clips_vertex_error[uniform draws]", "mm", 0.4)])
    assert (
        table.body[0] == ("coarse", "uniform draws", "0.25", "2.00", "1.25", "0.40", "")
        and "64 poses of" in table.notes[1]
    )


def test_a_training_that_there_is_not_is_named(capsys):
    assert training.main(["--only", "sparse"]) == 2
    assert "no training's name has 'sparse' in it; there are coarse, peak rate 0.002; " in capsys.readouterr().err


def test_a_choice_may_name_several_trainings():
    trainings = training.variants(700)
    chosen = training.selected(trainings, f"coarse, {BALANCED}|coarse, raw")
    assert [(v.method, v.change) for v in chosen if not v.clips] == [("coarse", BALANCED), ("coarse", RAW_ANIMATION)]
    assert [str(v) for v in training.selected(trainings, "raw animation, other")] == [
        "coarse, raw animation, other clips"
    ]
    assert training.selected(trainings, "") == trainings


def test_rare_intervals_get_as_many_draws_as_common_ones():
    assert draws_text([2, 90, 0, 3, 5]) == "2 of 4 intervals hold 5.0 % of the samples and get 50 % of the draws"


def test_the_controls_behind_the_intervals_are_named_strongest_first():
    facts = (None, 1, 9, "laptop", "bench-training")
    rows = [
        Row("bench_training", "teen", "samples", f"interval_correlation[{name}]", "ratio", value, *facts)
        for name, value in (("jaw_open", 0.5), ("squash", -0.7))
    ]
    said, line = axis_text(rows).splitlines()
    assert said.startswith("controls that the intervals follow most") and line == "teen: squash -0.70, jaw_open +0.50"
    assert axis_text([]) == ""
    assert trainings_tables(rows) == []


def test_a_rigid_motion_of_the_head_is_no_expression():
    rng = np.random.default_rng(3)
    neutral = rng.normal(size=(12, 3)) * 30
    smiles = neutral + rng.normal(size=(5, 1, 1)) * rng.normal(size=(12, 3))
    rotation, _ = np.linalg.qr(rng.normal(size=(5, 3, 3)))
    rotation *= np.sign(np.linalg.det(rotation))[:, None, None]
    turned = smiles @ rotation + rng.normal(size=(5, 1, 3)) * 100
    np.testing.assert_allclose(
        training.without_motion(turned, neutral), training.without_motion(smiles, neutral), atol=1e-9
    )
    np.testing.assert_allclose(training.without_motion(neutral[None] @ rotation[0], neutral)[0], neutral, atol=1e-9)


def test_a_rare_interval_counts_as_much_as_a_frequent_one(monkeypatch):
    neutral, count = np.random.default_rng(0).normal(size=(9, 3)).astype(np.float32) * 40, 40
    rig = SimpleNamespace(mesh=SimpleNamespace(neutral=neutral), landmarks=np.arange(3, 9))
    offsets = np.zeros((count, *neutral.shape), np.float32)
    offsets[:, rig.landmarks[0], 1] = [0.0] * 39 + [8.0]  # one pose in forty is an expression
    samples = SimpleNamespace(test_params=np.arange(count, dtype=np.float32)[:, None], test_offsets=offsets)
    monkeypatch.setattr(training.artefacts, "load_rig", lambda inputs: rig)
    monkeypatch.setattr(training.artefacts, "load_samples", lambda inputs: samples)
    of_pose = np.array([0.1] * 39 + [0.9]), np.array([1.0] * 39 + [5.0])
    errors = Errors(new_tally(1), new_tally(1), ("face",), *of_pose)
    config = resolve("tiny", "laptop")
    config = replace(config, evaluation=replace(config.evaluation, test_poses=0))
    variant = next(v for v in training.variants(700) if v.clips and v.change == BALANCED)
    rows = training._rows_by_interval("teen", {}, config, variant, errors)
    found = {row.metric: (row.value, row.poses) for row in rows}
    assert found[f"clips_normal_error_landmarks[{BALANCED}]"] == (3.0, 40), "1.1 in the mean over poses"
    assert found[f"clips_vertex_error_expressions[{BALANCED}]"][0] == pytest.approx(0.5)
    assert found[f"clips_normal_error_landmarks_15[{BALANCED}]"] == (5.0, 1)
    assert found[f"clips_normal_error_landmarks_00[{BALANCED}]"] == (1.0, 39)
    (left, right), legend = (figure := training.intervals_chart(rows, "teen")).axes, figure.axes[0].get_legend()
    assert [text.get_text() for text in legend.get_texts()] == ["augmented, balanced draws"]
    assert left.lines[0].get_ydata().tolist() == [1.0, 5.0] and right.get_title()
    assert trainings_tables(rows) and "40 poses" in trainings_tables(rows)[0].notes[-1]
