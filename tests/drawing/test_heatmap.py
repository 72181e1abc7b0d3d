"""Heatmaps: colours that mean what the bar says, brighter where the error is larger."""

import numpy as np
import pytest
from bumpy_plate import bumpy_plate

from replicate.drawing.heatmap import NO_NORMAL, ROOT, error_colours, normal_heat
from replicate.drawing.prop_surfaces import perceived
from replicate.report.pose_record import PoseRecord


@pytest.fixture
def record() -> PoseRecord:
    """A bumpy plate that two methods predict."""
    return bumpy_plate()


def test_no_error_has_the_first_colour_and_the_limit_and_more_the_last():
    colours = error_colours(np.float32([0, 5, 10, 50, np.nan]), 10)
    assert (colours[0] == error_colours(np.float32([0]), 1)[0]).all()
    assert (colours[2] == colours[3]).all() and (colours[1] != colours[2]).any()
    assert tuple(colours[4]) == NO_NORMAL


def test_twelve_degrees_and_twenty_two_look_apart_and_one_is_seen():
    none, one, twelve, more = perceived(error_colours(np.float32([0, 1, 12, 22]), 30.0, ROOT).tolist())
    assert np.linalg.norm(more - twelve) > 25 and np.linalg.norm(one - none) > 10


def test_brightness_rises_with_the_error():
    colours = error_colours(np.linspace(0, 10, 50, dtype=np.float32), 10) / 255
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    assert (np.diff(linear @ [0.2126, 0.7152, 0.0722]) > 0).all()


def test_the_heat_of_a_perfect_prediction_is_one_colour_and_unlit(record):
    truth = record.vertices["truth"]
    heat = normal_heat(truth, truth, record.faces, 10.0)
    assert len(np.unique(heat.colours, axis=0)) == 1 and not heat.lit
