"""Pictures that processes of one command share: drawn once, never mistaken for another, gone at the end."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from replicate.base.paths import ROOT
from replicate.drawing.render import PLACE, drawn_once, render, shared_pictures
from replicate.drawing.scene import Camera, Surface

SQUARE = Surface(np.float32([[-20, -20, 0], [20, -20, 0], [20, 20, 0], [-20, 20, 0]]), np.int32([[0, 1, 2], [0, 2, 3]]))
VIEW = Camera((0, 0, 0), 80)


@pytest.fixture(autouse=True)
def alone(monkeypatch):
    """Without the folder that all tests share."""
    monkeypatch.delenv(PLACE, raising=False)


def grey(value):
    return np.full((2, 2, 3), value, np.uint8)


def draw_again():
    raise AssertionError("drawn a second time")


def test_a_picture_is_drawn_once_within_and_each_time_without():
    with shared_pictures():
        assert np.array_equal(drawn_once(lambda: grey(1), "a", 1), grey(1))
        assert np.array_equal(drawn_once(draw_again, "a", 1), grey(1))
    with pytest.raises(AssertionError, match="second time"):
        drawn_once(draw_again, "a", 1)


def test_a_context_within_another_has_its_pictures():
    with shared_pictures():
        drawn_once(lambda: grey(1), "a")
        with shared_pictures():
            drawn_once(draw_again, "a")
        drawn_once(draw_again, "a")


def test_another_process_takes_what_this_one_has_drawn():
    with shared_pictures():
        drawn_once(lambda: grey(7), "b", SQUARE, VIEW)
        code = (
            "import sys; sys.path[:0] = ['tests/drawing']\n"
            "from test_shared_pictures import *\n"
            "assert (drawn_once(draw_again, 'b', SQUARE, VIEW) == 7).all()"
        )
        subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)


@pytest.mark.parametrize(
    "other",
    [
        ([replace(SQUARE, vertices=SQUARE.vertices + np.float32([0, 0, 1e-5]))], VIEW),
        ([replace(SQUARE, vertices=SQUARE.vertices.astype(float))], VIEW),
        ([replace(SQUARE, colours=(1, 2, 3))], VIEW),
        ([replace(SQUARE, lit=False)], VIEW),
        ([SQUARE, SQUARE], VIEW),
        ([SQUARE], Camera((0, 0, 0), 80, 1)),
    ],
)
def test_what_differs_in_anything_is_another_picture(other):
    with shared_pictures():
        drawn_once(lambda: grey(1), [SQUARE], VIEW)
        assert np.array_equal(drawn_once(lambda: grey(2), *other), grey(2))


def test_a_shared_rendering_is_the_rendering():
    alone = render([SQUARE], VIEW, 40, 30)
    with shared_pictures():
        for _ in range(2):
            assert np.array_equal(render([SQUARE], VIEW, 40, 30), alone)
        assert len(os.listdir(os.environ[PLACE])) == 1


def test_nothing_is_left_and_a_folder_that_is_gone_costs_time_alone(monkeypatch):
    monkeypatch.setenv(PLACE, "/nowhere")
    with shared_pictures():
        folder = os.environ[PLACE]
        drawn_once(lambda: grey(1), "a")
    assert not os.path.exists(folder)
    assert os.environ[PLACE] == "/nowhere"
    assert np.array_equal(drawn_once(lambda: grey(3), "a"), grey(3))
