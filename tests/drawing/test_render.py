"""Rays and OpenGL draw what geometry says; where both are missing one is told what to install."""

import subprocess
import sys

import numpy as np
import pytest

from replicate.base.exceptions import RunError
from replicate.base.paths import ROOT
from replicate.drawing import render as module
from replicate.drawing.light import Lamp, Studio
from replicate.drawing.render import opengl_works, render
from replicate.drawing.scene import MATT, WET, Camera, Surface

SQUARE = np.float32([[-20, -20, 0], [20, -20, 0], [20, 20, 0], [-20, 20, 0]])
QUAD = np.int32([[0, 1, 2], [0, 2, 3]])
VIEW = Camera((0, 0, 0), 80)


@pytest.fixture(params=["rays", "opengl"])
def way(request, monkeypatch):
    """Each way to draw."""
    if request.param == "opengl":
        if not opengl_works():
            pytest.skip("no OpenGL here")
        monkeypatch.setattr(module, "find_spec", lambda name: None)
    else:
        pytest.importorskip("embreex")


def sphere(radius=30.0, rings=24):
    """A sphere of rings and columns, with its poles."""
    theta, phi = np.meshgrid(
        np.linspace(0, np.pi, rings + 1)[1:-1], np.linspace(0, 2 * np.pi, 2 * rings, False), indexing="ij"
    )
    ring = np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi)], -1).reshape(-1, 3)
    vertices = np.concatenate([[[0, 1, 0]], ring, [[0, -1, 0]]]) * radius
    grid = 1 + np.arange(len(ring)).reshape(rings - 1, 2 * rings)
    after = np.roll(grid, -1, 1)
    a, b, c, d = (x.ravel() for x in (grid[:-1], after[:-1], after[1:], grid[1:]))
    top = np.stack([np.zeros(2 * rings, int), after[0], grid[0]], 1)
    bottom = np.stack([np.full(2 * rings, len(ring) + 1), grid[-1], after[-1]], 1)
    faces = np.concatenate([top[:, [0, 2, 1]], np.stack([a, d, c], 1), np.stack([a, c, b], 1), bottom[:, [0, 2, 1]]])
    return np.float32(vertices), np.int32(faces)


def test_a_square_covers_the_pixels_that_it_should(way):
    image = render([Surface(SQUARE, QUAD, (10, 200, 30), lit=False)], VIEW, 80, 80)
    coverage = (image != 255).any(-1)
    assert coverage[21:59, 21:59].all() and coverage.sum() == pytest.approx(1600, abs=90)
    assert (image[40, 40] == (10, 200, 30)).all()


def test_unlit_face_colours_are_the_colours_given(way):
    colours = np.uint8([[250, 3, 77], [5, 120, 240]])
    image = render([Surface(SQUARE, QUAD, colours, lit=False)], VIEW, 80, 80)
    assert (image[50, 50] == colours[0]).all() and (image[30, 30] == colours[1]).all()


def test_paint_is_blended_between_the_vertices(way):
    paint = np.uint8([[0, 0, 0], [200, 0, 0], [200, 100, 0], [0, 100, 0]])
    image = render([Surface(SQUARE, QUAD, lit=False, paint=paint)], VIEW, 80, 80).astype(int)
    np.testing.assert_allclose(image[40, 22:58, 0], (np.arange(22, 58) - 19.5) * 5, atol=4)
    np.testing.assert_allclose(image[22:58, 40, 1], (59.5 - np.arange(22, 58)) * 2.5, atol=4)
    assert (image[40, 40] != 255).all()


def test_a_coloured_light_tints_and_a_wet_finish_glints(way):
    grey, nothing = (0.5, 0.5, 0.5), (0.0, 0.0, 0.0)
    red = Studio((Lamp((0.0, 0.0, 1.0), 5, 8, 0.5, (1.0, 0.0, 0.0)),), grey, grey, nothing, sky=0.2)
    flat = render([Surface(SQUARE, QUAD, (200, 200, 200))], VIEW, 40, 40, studio=red)[25, 12].astype(int)
    assert flat[0] > flat[1] + 50 and abs(flat[1] - flat[2]) < 6
    white = Studio((Lamp((-0.5, 0.5, 0.7), 5, 8, 0.6, (1.0, 1.0, 1.0)),), grey, grey, nothing, sky=0.2)
    ball = [render([Surface(*sphere(), (90, 90, 90), finish=f)], VIEW, 80, 80, (0, 0, 0), white) for f in (MATT, WET)]
    assert int(ball[1].max()) > int(ball[0].max()) + 6  # the glint
    assert np.abs(ball[1][45, 50].astype(int) - ball[0][45, 50]).max() < 20  # and nothing beside it


def test_what_is_nearer_hides_what_is_farther_in_either_order(way):
    near = Surface(SQUARE * 0.5 + np.float32([0, 0, 10]), QUAD, (255, 0, 0), lit=False)
    far = Surface(SQUARE, QUAD, (0, 0, 255), lit=False)
    one, other = (render(order, VIEW, 80, 80) for order in ([near, far], [far, near]))
    assert (one[40, 40] == (255, 0, 0)).all() and (one[25, 25] == (0, 0, 255)).all()
    np.testing.assert_array_equal(one, other)


def test_light_falls_from_the_upper_left(way):
    image = render([Surface(*sphere())], VIEW, 80, 80).mean(-1)
    assert image[28, 30] > image[40, 40] + 5 > image[52, 50] + 10


def test_both_sides_of_a_face_are_lit_alike(way):
    turned = SQUARE @ np.float32([[0.8, 0, -0.6], [0, 1, 0], [0.6, 0, 0.8]])
    front, back = (render([Surface(turned, faces)], VIEW, 40, 40).astype(int) for faces in (QUAD, QUAD[:, ::-1]))
    assert np.abs(front - back).max() <= 2


def test_a_round_surface_has_no_facets(way):
    image = render([Surface(*sphere(rings=12))], VIEW, 80, 80)[25:55, 25:55].mean(-1)
    assert np.abs(np.diff(image, 2, axis=0)).max() < 4


def test_without_rays_and_opengl_one_is_told_what_to_install(monkeypatch):
    monkeypatch.setattr(module, "find_spec", lambda name: None)
    monkeypatch.setattr(module, "_PROBE", "import os; os.kill(os.getpid(), 11)")  # what VTK does
    opengl_works.cache_clear()
    try:
        with (
            pytest.warns(UserWarning, match="exit status -11.*libegl1 and libgl1-mesa-dri"),
            pytest.raises(RunError, match="expected embreex or OpenGL"),
        ):
            render([Surface(SQUARE, QUAD)], VIEW, 20, 20)
    finally:
        opengl_works.cache_clear()


@pytest.mark.parametrize(
    "display, setting, expected", [("", "", "vtkEGLRenderWindow"), (":0", "", None), ("", "mine", "mine")]
)
def test_egl_is_chosen_without_a_display_and_the_variable_is_never_empty(monkeypatch, display, setting, expected):
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("DISPLAY", display)
    monkeypatch.setenv("VTK_DEFAULT_OPENGL_WINDOW", setting)
    module._choose_window()
    assert module.os.environ.get("VTK_DEFAULT_OPENGL_WINDOW") == expected


def test_figures_are_imported_without_pyvista_trimesh_or_matplotlib():
    program = (
        "import sys\n"
        "for name in ('pyvista', 'trimesh', 'matplotlib', 'vtk', 'nbclient'): sys.modules[name] = None\n"
        "import replicate.targets.figure10, replicate.targets.figure09.forehead_wrinkles\n"
        "import replicate.targets.table2.charts, replicate.targets.table2.charts\n"
        "import replicate.report.pose_record, replicate.targets.compare\n"
    )
    process = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT)
    assert process.returncode == 0, process.stderr
