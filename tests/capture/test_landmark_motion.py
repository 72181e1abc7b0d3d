"""Landmarks to control points: the paper's formula by hand, scale, smoothing, steadying, and what measures a motion."""

import numpy as np
import pytest

from replicate.base.exceptions import InputError
from replicate.capture.capture_config import CaptureConfig
from replicate.capture.landmark_file import MM, PIXELS, Recording
from replicate.capture.landmark_motion import control_motion, jitter_mm, steadied, telling_frames

NEUTRAL = np.array([[0.0, 0.0, 60.0], [20.0, 0.0, 50.0], [0.0, 30.0, 55.0]], np.float32)
PLAIN = CaptureConfig(scale="none", neutral_frames=1, smoothing_frames=1)


def recorded(frames=12, seed=0):
    """An actor's landmarks: another face that moves smoothly, at rest in the first frame."""
    rest = np.array([[5.0, 1.0], [11.0, 2.0], [4.0, 12.0]])
    direction = np.random.default_rng(seed).normal(size=(3, 2))
    return rest + np.sin(np.linspace(0, 2, frames))[:, None, None] * direction


def changed(**values):
    return CaptureConfig(**{"scale": "none", "neutral_frames": 1, "smoothing_frames": 1, **values})


def test_control_points_are_the_characters_own_and_the_actors_movement():
    places = recorded()
    motion = control_motion(Recording(places, MM, 0), NEUTRAL, PLAIN)
    np.testing.assert_allclose(motion.targets[..., :2], NEUTRAL[:, :2] + places - places[0], atol=1e-5)
    assert (motion.targets[..., 2] == NEUTRAL[:, 2]).all() and motion.scale == 1.0


def test_the_movement_is_in_sizes_of_the_face_whatever_the_picture_shows():
    one = control_motion(Recording(recorded(), MM, 0), NEUTRAL, changed(scale="face"))
    large = control_motion(Recording(7 * recorded() + 300, PIXELS, 0), NEUTRAL, changed(scale="face"))
    np.testing.assert_allclose(one.targets, large.targets, atol=1e-4)
    assert one.scale == pytest.approx(7 * large.scale) and one.scale != 1.0


def test_the_neutral_expression_is_the_mean_of_the_first_frames():
    places = recorded()
    motion = control_motion(Recording(places, MM, 0), NEUTRAL, changed(neutral_frames=4))
    np.testing.assert_allclose(motion.targets[:4, :, :2].mean(0), NEUTRAL[:, :2], atol=1e-5)


def test_smoothing_takes_noise_away_and_leaves_a_parabola_as_it_is():
    time = np.arange(40.0)[:, None, None]
    parabola = np.tile(0.01 * time**2, (1, 3, 2)) + recorded()[0]
    noisy = parabola + np.random.default_rng(1).normal(size=parabola.shape)
    for places, section in ((parabola, changed(smoothing_frames=7)), (noisy, changed(smoothing_frames=7))):
        rough = control_motion(Recording(places, MM, 0), NEUTRAL, PLAIN).targets
        smooth = control_motion(Recording(places, MM, 0), NEUTRAL, section).targets
        if places is parabola:
            np.testing.assert_allclose(smooth[3:-3], rough[3:-3], atol=1e-4)
        else:
            assert jitter_mm(smooth) < 0.4 * jitter_mm(rough)


def test_a_recording_at_another_rate_takes_as_long():
    places = recorded(61)
    motion = control_motion(Recording(places, MM, 0), NEUTRAL, changed(frames_per_second=60.0))
    assert len(motion.targets) == 25
    np.testing.assert_allclose(motion.recorded[::2], places[::5], atol=1e-12)


def test_a_steady_head_neither_shifts_nor_turns_nor_grows():
    places, angle = recorded(), np.linspace(0, 0.4, 12)
    turned = np.stack([[[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]] for a in angle])
    shaken = (1 + angle)[:, None, None] * np.einsum("tlc,tcd->tld", np.tile(places[:1], (12, 1, 1)), turned)
    np.testing.assert_allclose(steadied(shaken + angle[:, None, None], places[0]), np.tile(places[:1], (12, 1, 1)))
    section = changed(head="steady")
    still = control_motion(Recording(shaken, MM, 0), NEUTRAL, section).targets
    np.testing.assert_allclose(still, np.tile(NEUTRAL, (12, 1, 1)), atol=1e-4)
    assert np.abs(control_motion(Recording(shaken, MM, 0), NEUTRAL, PLAIN).targets - NEUTRAL).max() > 1


def test_jitter_is_the_second_difference():
    straight = np.arange(5.0)[:, None, None] * np.ones((1, 2, 2))
    assert jitter_mm(straight) == 0.0
    assert jitter_mm(straight**2) == pytest.approx(2 * np.sqrt(2))


def test_telling_frames_are_the_farthest_from_rest_and_from_each_other():
    places = np.zeros((10, 1, 3))
    places[4], places[5], places[8] = 5.0, 4.9, -3.0
    assert telling_frames(places, 2) == [4, 8]
    assert len(telling_frames(places[:3], 5)) == 3


@pytest.mark.parametrize(
    ("recording", "section", "sentence"),
    [
        (Recording(recorded(3), MM, 0), changed(neutral_frames=3), "expected more than 3 frames, got 3"),
        (Recording(recorded(), PIXELS, 0), PLAIN, "landmarks in pixels need a scale"),
    ],
)
def test_recordings_that_say_nothing_are_refused(recording, section, sentence):
    with pytest.raises(InputError, match=sentence):
        control_motion(recording, NEUTRAL, section)


@pytest.mark.parametrize("frames", [2, 4, 0])
def test_a_window_of_smoothing_has_a_middle(frames):
    with pytest.raises(InputError, match=r"smoothing_frames(: expected| is) "):
        CaptureConfig(smoothing_frames=frames)
