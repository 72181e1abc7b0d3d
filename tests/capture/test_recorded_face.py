"""Faces that a recording shows: upright ones pass, with noise and in pixels; points and turned ones get a sentence."""

import numpy as np
import pytest
import rigs

from data_recipes.catalogue import FACE_LANDMARKS
from replicate.base.exceptions import InputError
from replicate.capture.capture_config import CaptureConfig
from replicate.capture.landmark_file import MM, PIXELS, Recording, read_landmarks, write_landmarks
from replicate.capture.landmark_motion import check_face

NAMES = tuple(FACE_LANDMARKS)
FACE, STEADY, PLAIN = CaptureConfig(), CaptureConfig(head="steady"), CaptureConfig(scale="none")


@pytest.fixture(scope="module")
def still():
    """Five frames (5, 54, 2) of a character's landmarks at rest, mm, y up."""
    rig = rigs.landmark_rig("tiny")
    return np.tile(rig.mesh.neutral[rig.control_points, :2].astype(float), (5, 1, 1))


def turned(places, degrees):
    angle = np.deg2rad(degrees)
    return places @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def test_an_upright_face_passes_with_noise_and_with_a_head_that_leans(still):
    noise = np.random.default_rng(0).normal(size=still.shape)
    for places in (still, still + 4 * noise, turned(still, 30), turned(still, -30), 1e3 * still - 1e5):
        for section in (FACE, STEADY, PLAIN):
            check_face(Recording(places, MM, 0), NAMES, section)


def test_pixels_count_after_they_are_turned_to_point_up(still, tmp_path):
    pixels = 2 * still * (1, -1) + 500
    write_landmarks(tmp_path / "a.csv", pixels, NAMES, PIXELS)
    check_face(read_landmarks(tmp_path / "a.csv", NAMES, 0), NAMES, FACE)
    write_landmarks(tmp_path / "a.csv", pixels, NAMES, MM)
    with pytest.raises(InputError, match=r"the brows are below the chin .*: y points up in mm; turn the sign of y"):
        check_face(read_landmarks(tmp_path / "a.csv", NAMES, 0), NAMES, FACE)


@pytest.mark.parametrize("unit", [MM, PIXELS])
def test_a_face_that_is_not_upright_is_refused_with_what_mends_it(still, unit):
    y = "y points up in mm" if unit == MM else "y points down in pixels"
    for places, sentence in (
        (still * (1, -1), f"the brows are below the chin and have to be above it: {y}; turn the sign of y"),
        (turned(still, 180), f"the brows are below the chin and have to be above it: {y}"),
        (still[..., ::-1], f"the face lies on its side .* right and {y}; perhaps x and y have changed places"),
        (turned(still, 90), "the face lies on its side"),
        (still * (-1, 1), "the face's left has the smaller x .* the face's own left; turn the sign of x"),
    ):
        for section in (FACE, STEADY):
            with pytest.raises(InputError, match=f"in the neutral frames {sentence}"):
                check_face(Recording(places, unit, 0), NAMES, section)


def test_only_the_neutral_frames_must_be_upright(still):
    places = still.copy()
    places[3:] = turned(places[3:], 120)
    check_face(Recording(places, MM, 0), NAMES, FACE)


@pytest.mark.parametrize("value", [0.0, 0.1, -7e5])
def test_landmarks_in_one_place_are_refused_where_a_size_counts(value):
    recording = Recording(np.full((5, 54, 2), value), MM, 0)
    for section in (FACE, STEADY, CaptureConfig(scale="none", head="steady")):
        with pytest.raises(InputError, match="all landmarks of the neutral frames are in one place"):
            check_face(recording, NAMES, section)
    check_face(recording, NAMES, PLAIN)


def test_a_steady_head_has_a_size_in_every_frame(still):
    places = still.copy()
    places[4] = 0.1
    with pytest.raises(InputError, match="all landmarks of frame 4, counted from 0, are in one place"):
        check_face(Recording(places, MM, 0), NAMES, STEADY)
    check_face(Recording(places, MM, 0), NAMES, FACE)
