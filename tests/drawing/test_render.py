"""Both renderers draw what geometry says, and the same picture; where OpenGL is missing a figure still comes out."""

import subprocess
import sys

import numpy as np
import pytest

from replicate.base.paths import ROOT
from replicate.drawing import render as module
from replicate.drawing.render import render, working_renderer
from replicate.drawing.scene import MATT, PORTRAIT, STUDIO, Camera, Finish, Light, Lighting, Surface

SQUARE = np.float32([[-20, -20, 0], [20, -20, 0], [20, 20, 0], [-20, 20, 0]])
QUAD = np.int32([[0, 1, 2], [0, 2, 3]])
VIEW = Camera((0, 0, 0), 80)


@pytest.fixture(params=["software", "pyvista"])
def renderer(request):
    if request.param == "pyvista" and working_renderer() != "pyvista":
        pytest.skip("no OpenGL here")
    return request.param


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


def test_a_square_covers_the_pixels_that_it_should(renderer):
    image = render([Surface(SQUARE, QUAD, (10, 200, 30), lit=False)], VIEW, 80, 80, renderer=renderer)
    coverage = (image != 255).any(-1)
    assert coverage[21:59, 21:59].all() and coverage.sum() == pytest.approx(1600, abs=90)
    assert (image[40, 40] == (10, 200, 30)).all()


def test_unlit_face_colours_are_the_colours_given(renderer):
    colours = np.uint8([[250, 3, 77], [5, 120, 240]])
    image = render([Surface(SQUARE, QUAD, colours, lit=False, smooth=False)], VIEW, 80, 80, renderer=renderer)
    assert (image[50, 50] == colours[0]).all() and (image[30, 30] == colours[1]).all()


def test_paint_is_blended_between_the_vertices(renderer):
    paint = np.uint8([[0, 0, 0], [200, 0, 0], [200, 100, 0], [0, 100, 0]])
    image = render([Surface(SQUARE, QUAD, lit=False, paint=paint)], VIEW, 80, 80, renderer=renderer).astype(int)
    np.testing.assert_allclose(image[40, 22:58, 0], (np.arange(22, 58) - 19.5) * 5, atol=4)
    np.testing.assert_allclose(image[22:58, 40, 1], (59.5 - np.arange(22, 58)) * 2.5, atol=4)
    assert (image[40, 40] != 255).all()


def test_a_coloured_light_tints_and_a_sharp_finish_glints(renderer):
    red = Lighting((Light((0, 0, 1), 0.5, (1.0, 0.0, 0.0)),), 0.2)
    flat = render([Surface(SQUARE, QUAD, (200, 200, 200))], VIEW, 40, 40, renderer=renderer, lighting=red)[25, 12]
    assert flat[0] > flat[1] + 60 and abs(int(flat[1]) - 40) < 6
    white = Lighting((Light((-0.5, 0.5, 0.7), 0.6),), 0.2)
    ball = [
        render([Surface(*sphere(), (90, 90, 90), finish=f)], VIEW, 80, 80, (0, 0, 0), renderer, white)
        for f in (MATT, Finish(1.0, 100.0))
    ]
    assert int(ball[1].max()) > int(ball[0].max()) + 60  # the glint
    assert np.abs(ball[1][45, 50].astype(int) - ball[0][45, 50]).max() < 20  # and nothing beside it


def test_what_is_nearer_hides_what_is_farther_in_either_order(renderer):
    near = Surface(SQUARE * 0.5 + np.float32([0, 0, 10]), QUAD, (255, 0, 0), lit=False)
    far = Surface(SQUARE, QUAD, (0, 0, 255), lit=False)
    one, other = (render(order, VIEW, 80, 80, renderer=renderer) for order in ([near, far], [far, near]))
    assert (one[40, 40] == (255, 0, 0)).all() and (one[25, 25] == (0, 0, 255)).all()
    np.testing.assert_array_equal(one, other)


def test_light_falls_from_the_upper_left(renderer):
    image = render([Surface(*sphere())], VIEW, 80, 80, renderer=renderer).mean(-1)
    assert image[28, 30] > image[40, 40] + 5 > image[52, 50] + 10


def test_both_sides_of_a_face_are_lit_alike(renderer):
    turned = SQUARE @ np.float32([[0.8, 0, -0.6], [0, 1, 0], [0.6, 0, 0.8]])
    front, back = (
        render([Surface(turned, faces, smooth=False)], VIEW, 40, 40, renderer=renderer).astype(int)
        for faces in (QUAD, QUAD[:, ::-1])
    )
    assert np.abs(front - back).max() <= 2


def test_smooth_shading_has_no_facets_and_flat_shading_has(renderer):
    vertices, faces = sphere(rings=8)
    smooth, flat = (
        render([Surface(vertices, faces, smooth=s)], VIEW, 80, 80, renderer=renderer)[30:50, 30:50].mean(-1)
        for s in (True, False)
    )
    assert np.abs(np.diff(smooth, axis=0)).max() < 0.5 * np.abs(np.diff(flat, axis=0)).max()


def test_far_skin_throws_no_ripples_onto_itself():
    def ripples(distance_mm: float) -> float:
        slope = np.float32([[-90, -90, 60], [90, -90, 20], [90, 90, -60], [-90, 90, -20]])
        surface = Surface(slope, np.int32([[0, 1, 2], [0, 2, 3]]), smooth=False)
        picture = render([surface], Camera((0, 0, 0), 60, distance_mm=distance_mm), 120, 120, renderer="pyvista")
        return float(picture[20:-20, 20:-20].astype(float).std(axis=(0, 1)).max())

    assert module.shade_bias_mm(Camera((0, 0, 0), 60, distance_mm=1_170), STUDIO) == 1.0
    assert module.shade_bias_mm(Camera((0, 0, 0), 60, distance_mm=930), STUDIO) == STUDIO.shade_from_mm
    if working_renderer() == "pyvista":
        assert ripples(1_170) < 2.0, "3.5 where hollows of 0.5 mm are shaded"


@pytest.mark.parametrize("lighting", [STUDIO, PORTRAIT], ids=["studio", "portrait"])
def test_the_two_renderers_draw_the_same_picture(lighting):
    if working_renderer() != "pyvista":
        pytest.skip("no OpenGL here")
    vertices, faces = sphere()
    paint = np.uint8(255 * (0.5 + vertices / 80))
    square = Surface(SQUARE + np.float32([12, -9, 25]), QUAD, (200, 120, 40), smooth=False)
    scene = [Surface(vertices, faces, paint=paint, finish=Finish(0.6, 40.0)), square]
    view = Camera((3, 2, 0), 90, 25, 15)
    a, b = (render(scene, view, 120, 90, renderer=r, lighting=lighting).astype(int) for r in ("pyvista", "software"))
    assert np.abs(a - b).mean() < 1.0 and (np.abs(a - b).max(-1) > 24).mean() < 0.01


def test_without_opengl_a_figure_still_comes_out_and_says_what_to_install(monkeypatch):
    monkeypatch.setattr(module, "_PROBE", "import os; os.kill(os.getpid(), 11)")  # what VTK does
    working_renderer.cache_clear()
    try:
        with pytest.warns(UserWarning, match="exit status -11.*libegl1 and libgl1-mesa-dri"):
            image = render([Surface(SQUARE, QUAD)], VIEW, 20, 20)
        assert (image[10, 10] != 255).any()
    finally:
        working_renderer.cache_clear()


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
