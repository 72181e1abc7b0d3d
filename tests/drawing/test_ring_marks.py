"""Rings stand around the places that they mark, and nowhere else."""

import numpy as np

from replicate.drawing.marks import LINE, REACH, ROOM, ringed
from replicate.drawing.scene import Camera

CAMERA = Camera((0, 0, 0), 100.0, distance_mm=1e6)
GREY = np.full((200, 200, 3), 120, np.uint8)
MAGENTA = (220, 0, 110)


def marked(*places):
    picture = ringed(GREY, np.float64(places).reshape(-1, 3), CAMERA, MAGENTA)
    return np.argwhere((picture == MAGENTA).all(-1)) + 0.5


def test_a_ring_lies_around_its_place_and_leaves_it_to_be_seen():
    rows, columns = marked((20, 10, 0)).T
    away = np.hypot(columns - 140, rows - 80)
    assert len(away) > 30 and np.abs(away - ROOM * 200).max() <= LINE * 200


def test_near_places_share_a_ring_and_far_ones_have_their_own():
    near = 0.4 * REACH * 100
    assert np.ptp(marked((0, 0, 0), (near, 0, 0)), axis=0)[1] < 2 * 200 * (REACH + ROOM)
    alone, both = len(marked((-30, 0, 0))), len(marked((-30, 0, 0), (30, 0, 0)))
    assert abs(both - 2 * alone) <= 4


def test_places_outside_the_picture_have_no_ring_and_the_picture_given_stays_as_it_is():
    assert len(marked((80, 0, 0))) == len(marked()) == 0
    before = GREY.copy()
    ringed(GREY, np.zeros((1, 3)), CAMERA, MAGENTA)
    np.testing.assert_array_equal(GREY, before)
