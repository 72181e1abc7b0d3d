"""Figure 12's curves name what they show, and its performances keep their own rate."""

from types import SimpleNamespace

import numpy as np
import pytest
from plain_rig import PlainRig

from replicate.capture.capture_config import CaptureConfig
from replicate.capture.landmark_file import MM, Recording
from replicate.inverse.control_points import default_section as inverse_section
from replicate.report.results import Row
from replicate.targets.figure12.rows import (
    METRICS,
    NEUTRAL,
    RIDGE,
    TABLE,
    CaptureTrial,
    metric_name,
    targets_of,
    windows,
)
from replicate.targets.figure12.shown import noise_curves

ALL = ["ridge regression", "neutral pose"]
NEUTRAL_LANDMARKS = np.random.default_rng(0).normal(size=(6, 3)).astype(np.float32)


class Marked(PlainRig):
    mesh = SimpleNamespace(neutral=NEUTRAL_LANDMARKS)
    control_points = np.arange(6, dtype=np.int32)


def trial_of(**capture):
    section = CaptureConfig(noises_mm=(0.0, 2.0), **capture)
    return CaptureTrial("teen", ("teen",), "quick", 0, section, inverse_section("quick"), ())


def rows_of(trial):
    return [
        Row(TABLE, "teen", name, metric_name(metric, "teen", noise, window > 1), unit, 1 + noise, None, 1, 9, "q", "r")
        for name in (RIDGE, NEUTRAL)
        for noise in trial.noises_mm
        for window in windows(trial)
        for metric, (unit, _) in METRICS.items()
        if not (name == NEUTRAL and metric == "jitter")
    ]


def legend(figure):
    (only,) = figure.legends
    return [text.get_text() for text in only.get_texts()]


@pytest.mark.parametrize(
    ("frames", "styles", "alt", "caption"),
    [
        (7, ["-", "--", "-"], "Landmarks, smoothed: ridge regression from 1.00 to 3.00 mm; neutral pose", "over 7"),
        (1, ["-", "-"], "Landmarks, as they are: ridge regression from 1.00 to 3.00 mm; neutral pose", "Nothing is"),
    ],
)
def test_the_legend_and_the_words_name_every_driver_with_and_without_smoothing(frames, styles, alt, caption):
    trial = trial_of(smoothing_frames=frames)
    figure, words = noise_curves(trial, rows_of(trial))
    assert legend(figure) == ALL
    assert [line.get_linestyle() for line in figure.axes[0].lines] == styles
    assert alt in words.alt and caption in words.caption


def test_a_performance_keeps_its_frames_whatever_rate_a_recording_of_the_user_has():
    places = NEUTRAL_LANDMARKS[:, :2] + np.linspace(0, 1, 100)[:, None, None]
    recording = Recording(places.astype(float), MM, 0)
    found = [targets_of(trial_of(frames_per_second=rate), recording, Marked(), 7)[0] for rate in (24.0, 30.0)]
    assert len(found[1]) == 100
    np.testing.assert_array_equal(*found)
