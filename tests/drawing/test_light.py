"""Light by rays, on shapes whose light is known: planes, walls and spheres."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from replicate.drawing.light import (
    PORTRAIT,
    Lamp,
    Studio,
    cone,
    depth_mm,
    directions_around,
    glints,
    light_at,
    quick,
    scene_of,
    spread,
    to_linear,
    to_srgb,
    trace,
    uncovered,
)
from replicate.drawing.scene import Camera, Surface

pytest.importorskip("embreex")

SQUARE = np.float32([[-20, -20, 0], [20, -20, 0], [20, 20, 0], [-20, 20, 0]])
QUAD = np.int32([[0, 1, 2], [0, 2, 3]])
VIEW = Camera((0, 0, 0), 80)
GREY = (128, 128, 128)
SKY = Studio((), (1.0, 1.0, 1.0), (1.0, 1.0, 1.0), (0.0, 0.0, 0.0), sky=0.5, gloss=0.0, exposure=1.0, saturation=1.0)


def lit_by(*lamps: Lamp) -> Studio:
    nothing = (0.0, 0.0, 0.0)
    return Studio(lamps, nothing, nothing, nothing, sky=0.0, gloss=0.0, exposure=1.0, saturation=1.0)


def brightness(image: np.ndarray) -> np.ndarray:
    return to_linear(image)[..., 1]


def ball() -> tuple[np.ndarray, np.ndarray]:
    sphere = trimesh.creation.icosphere(4, 30.0)
    return np.float32(sphere.vertices), np.int32(sphere.faces)


def grid(size: float, count: int = 41) -> tuple[np.ndarray, np.ndarray]:
    """A square in z = 0 of (count − 1)² quads."""
    x, y = np.meshgrid(*2 * [np.linspace(-size, size, count)])
    corner = np.arange(count**2).reshape(count, count)[:-1, :-1].ravel()
    quads = corner[:, None] + [0, 1, count + 1, count]
    return np.float32(np.stack([x, y, 0 * x], -1).reshape(-1, 3)), np.int32(quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3))


def test_a_plane_under_an_even_sky_is_as_bright_as_the_sky():
    image = trace([Surface(*grid(60), GREY)], VIEW, 40, 40, (0, 0, 0), SKY)
    np.testing.assert_allclose(brightness(image), 0.5 * to_linear(GREY)[0], rtol=0.02)


def test_a_wall_takes_half_of_the_sky_from_its_foot():
    wall = SQUARE[:, [2, 1, 0]] * 50 + np.float32([31.4, 0, 1000])  # in x = 31.4, far up and to both sides
    image = trace([Surface(*grid(60), GREY), Surface(wall, QUAD, GREY)], Camera((0, 0, 0), 80), 40, 40, (0, 0, 0), SKY)
    row = brightness(image)[20] / (0.5 * to_linear(GREY)[0])
    assert row[33] == pytest.approx(0.5, abs=0.08) and 0.5 < row[2] < 0.75 and (np.diff(row[:33]) < 0.02).all()


def test_a_lamp_throws_a_shadow_that_is_soft_for_a_wide_lamp():
    blocker = SQUARE * 0.5 + np.float32([0, 0, 40])
    camera = Camera((0, 0, 0), 80, elevation_deg=60)
    widths, darkest = [], []
    for spread_deg in (1, 25):
        studio = lit_by(Lamp((0.0, -0.866, 0.5), spread_deg, 64, 1.0, (1, 1, 1)))  # straight above the plane
        light = brightness(
            trace([Surface(*grid(60, 121), GREY), Surface(blocker, QUAD, GREY)], camera, 160, 160, (0, 0, 0), studio)
        )
        full = to_linear(GREY)[0]
        assert light[40:120, 10].min() > 0.95 * full, "nothing stands above there"
        shadow = light[40:120, 80] / full
        widths.append(((shadow > 0.1) & (shadow < 0.9)).sum())
        darkest.append(shadow.min())
    assert darkest[0] < 0.05 < darkest[1] and widths[1] > 3 * widths[0]


def test_a_sphere_is_brightest_where_it_faces_the_lamp():
    studio = lit_by(Lamp((0.6, 0.0, 0.8), 1, 8, 0.9, (1, 1, 1)))
    image = brightness(trace([Surface(*ball(), GREY)], VIEW, 160, 160, (0, 0, 0), studio))
    y, x = np.unravel_index(image.argmax(), image.shape)
    assert x == pytest.approx(80 + 0.6 * 60, abs=8) and y == pytest.approx(80, abs=8)
    assert image[80, 30] < 0.02, "its far side is in the dark"


def test_what_is_unlit_keeps_its_colours_and_what_is_behind_is_hidden():
    behind = Surface(SQUARE * 1.7 - np.float32([0, 0, 9]), QUAD, (255, 0, 0), lit=False)
    colours = np.uint8([[250, 3, 77], [5, 120, 240]])
    image = trace([behind, Surface(SQUARE, QUAD, colours, lit=False)], VIEW, 80, 80, (7, 8, 9), PORTRAIT)
    assert (image[50, 50] == colours[0]).all() and (image[30, 30] == colours[1]).all()
    assert (image[40, 10] == (255, 0, 0)).all() and (image[1, 1] < 10).all()


def test_what_a_cover_hides_of_a_face_leaves_no_stain_on_the_rest():
    """Vertices lie 10 mm apart: those 6 mm under the cover's edge share faces with pixels that nothing covers."""
    below, cover = grid(60, 13), SQUARE * 0.8 + np.float32([0, 0, 1])
    image = trace([Surface(*below, GREY), Surface(cover, QUAD, (0, 0, 0))], VIEW, 80, 80, (0, 0, 0), SKY)
    beside = brightness(image)[40, [18, 20, 22, 57, 59, 61]]
    assert beside.min() > 0.8 * 0.5 * to_linear(GREY)[0]


def test_covered_vertices_take_the_light_beside_them_from_the_edge_inwards():
    scene = scene_of([Surface(*grid(4, 9))], np.array([0.0, 0, 900]))
    x, every = scene.vertices[:, 0], np.arange(len(scene.vertices))
    light = np.where(x > 0, 0.1, 0.6)[:, None]
    np.testing.assert_allclose(uncovered(light, scene, every, x > 0), 0.6)
    np.testing.assert_array_equal(uncovered(light, scene, every, x < np.inf), light, "nothing beside them is known")


def test_light_spreads_under_skin_and_none_is_lost():
    scene = scene_of([Surface(*grid(20))], np.array([0.0, 0, 900]))
    every = np.arange(len(scene.vertices))
    even = np.full((len(every), 3), 0.4)
    np.testing.assert_allclose(spread(even, scene, every, (3.4, 1.5, 0.7)), even, rtol=1e-9)
    spot = np.zeros_like(even)
    spot[np.linalg.norm(scene.vertices, axis=1) < 3] = 1
    spreading = spread(spot, scene, every, (3.4, 1.5, 0.7))
    inside = spreading[np.linalg.norm(scene.vertices, axis=1) < 1].mean(0)
    assert inside[0] < inside[1] < inside[2] < 1, "red goes furthest"
    np.testing.assert_allclose(spreading.sum(0), spot.sum(0), rtol=0.1)


def test_points_that_see_all_of_a_lamp_have_its_light_by_their_slope():
    normals = np.array([[0.0, 0, 1], [0, np.sin(1.0), np.cos(1.0)], [0, 0, -1]])
    lamp = Lamp((0.0, 0.0, 1.0), 0.5, 16, 2.0, (1.0, 0.5, 0.25))
    light, shares = light_at(normals, np.eye(3), lit_by(lamp), lambda towards: normals @ towards.T > 0)
    np.testing.assert_allclose(light, np.outer([2, 2 * np.cos(1.0), 0], [1, 0.5, 0.25]), rtol=1e-3, atol=1e-9)
    np.testing.assert_allclose(shares[:, 0], [1, 1, 0], atol=1e-9)


def test_a_glint_is_where_the_eye_sees_the_lamp_mirrored():
    angles = np.radians(np.arange(-60, 61, 1.0))
    normals = np.stack([np.sin(angles), 0 * angles, np.cos(angles)], -1)
    eye, lamp = np.array([0.0, 0, 1]), np.array([np.sin(0.7), 0, np.cos(0.7)])
    shine = glints(normals, np.tile(eye, (len(angles), 1)), lamp, np.full(len(angles), 0.2))
    assert np.degrees(angles[shine.argmax()]) == pytest.approx(np.degrees(0.35), abs=2)


def test_directions_fill_a_sphere_and_a_cone_evenly():
    around = directions_around(128)
    np.testing.assert_allclose(np.linalg.norm(around, axis=1), 1)
    np.testing.assert_allclose(around.mean(0), 0, atol=0.01)
    axis = np.array([1.0, 2.0, -2.0]) / 3
    within = cone(axis, 20, 64)
    assert np.degrees(np.arccos(within @ axis)).max() < 20
    np.testing.assert_allclose(within.mean(0) / np.linalg.norm(within.mean(0)), axis, atol=0.01)


def test_colours_become_light_and_colours_again():
    colours = np.arange(256).repeat(3).reshape(-1, 3)
    np.testing.assert_array_equal(np.rint(255 * to_srgb(to_linear(colours))), colours)


def test_creases_are_dark_and_ridges_bright_in_raking_light():
    places, faces = grid(40, 161)
    wavy = places + np.float32([0, 0, 1]) * np.sin(places[:, :1] * 2 * np.pi / 8)
    depth = depth_mm(scene_of([Surface(wavy, faces)], np.array([0.0, 0, 900])))
    inside = np.abs(places).max(1) < 30
    assert np.corrcoef(depth[inside], -wavy[inside, 2])[0, 1] > 0.95
    plane = depth_mm(scene_of([Surface(places, faces)], np.array([0.0, 0, 900])))
    np.testing.assert_allclose(plane[inside], 0, atol=1e-6)
    dusty = replace(SKY, crease=0.9)
    clean, dark = (
        brightness(trace([Surface(wavy, faces, GREY)], Camera((0, 0, 0), 40), 80, 80, (0, 0, 0), studio))[40]
        for studio in (SKY, dusty)
    )
    height = np.sin((np.arange(80) - 39.5) * 0.5 * 2 * np.pi / 8)
    change = dark / clean
    assert change[height > 0.9].min() > 1 > change[height < -0.9].max(), "ridges brighter, hollows darker"


def test_a_quick_studio_has_the_same_light_from_fewer_rays():
    scene = [Surface(*ball(), (226, 178, 148))]
    slow, fast = (trace(scene, VIEW, 60, 60, (236, 239, 243), each).astype(int) for each in (PORTRAIT, quick(PORTRAIT)))
    assert quick(PORTRAIT).sky_rays < PORTRAIT.sky_rays / 5 and np.abs(slow - fast).mean() < 4


def test_a_hollow_is_as_dark_on_a_coarse_mesh_as_on_a_fine_one():
    def hollow(across: int) -> float:
        places, faces = grid(40, across)
        wavy = places + np.float32([0, 0, 3]) * np.sin(places[:, :1] * 2 * np.pi / 80)
        depth = depth_mm(scene_of([Surface(wavy, faces)], np.array([0.0, 0, 900])))
        return depth[(np.abs(wavy[:, 1]) < 5) & (np.abs(places[:, 0] + 20) < 3)].mean()

    fine, coarse = hollow(41), hollow(21)
    assert 0.8 < coarse / fine < 1.25 and fine > 0.1
