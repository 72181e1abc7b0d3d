"""The signed distance function and what is built on it."""

import numpy as np
import pytest
from heads import head

from data_recipes.head.shape import (
    build_shape,
    cone,
    distance_and_gradient,
    ellipsoid,
    eye_frame,
    project,
    raycast,
    rotation_y,
    skin_distance,
    skull_distance,
    smooth_max,
    smooth_min,
)
from data_recipes.recipe.reading import load_recipe

POINTS = np.random.default_rng(3).normal(size=(200, 3)) * 40


def test_a_sphere_by_ellipsoid_and_by_cone_is_the_true_distance():
    true = np.linalg.norm(POINTS, axis=1) - 30
    assert np.allclose(ellipsoid(POINTS, (0, 0, 0), (30, 30, 30)), true)
    assert np.allclose(cone(POINTS, (0, 0, 0), (0, 1e-6, 0), 30, 30), true, atol=1e-5)


def test_a_cone_of_one_radius_is_a_capsule():
    distances = cone(np.array([[5.0, 3, 0], [0, 14, 0], [0, -7, 0]]), (0, 0, 0), (0, 10, 0), 2, 2)
    assert np.allclose(distances, [3, 2, 5])


def test_smooth_minimum_is_the_minimum_far_from_the_seam_and_below_it_near():
    a, b = np.array([0.0, 0.0, 3.0]), np.array([10.0, 0.0, 2.0])
    assert np.allclose(smooth_min(a, b, 4.0), [0.0, -1.0, 2 - 9 / 16])
    assert np.allclose(smooth_max(-a, -b, 4.0), -smooth_min(a, b, 4.0))


def test_gradient_of_a_sphere_points_outwards_with_length_one():
    far = POINTS[np.linalg.norm(POINTS, axis=1) > 25]
    _, gradient = distance_and_gradient(lambda p: ellipsoid(p, (0, 0, 0), (30, 30, 30)), far)
    assert np.allclose(gradient, far / np.linalg.norm(far, axis=1, keepdims=True), atol=2e-3)


def test_projection_and_raycast_land_on_a_sphere():
    sphere = lambda p: ellipsoid(p, (0, 0, 0), (30, 30, 30))  # noqa: E731
    start = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True) * 33
    assert np.abs(sphere(project(sphere, start, steps=3))).max() < 1e-3
    hit = raycast(sphere, np.zeros((2, 3)), np.array([[1.0, 0, 0], [0, 0.6, 0.8]]))
    assert np.allclose(hit, [[30, 0, 0], [0, 18, 24]], atol=2e-3)


@pytest.mark.parametrize("name", ("tiny", "teen"))
def test_head_is_symmetric_and_the_skull_has_no_lips(name):
    recipe = load_recipe(name)
    shape = build_shape(recipe)
    flipped = POINTS * (-1, 1, 1)
    assert np.allclose(skin_distance(shape, POINTS), skin_distance(shape, flipped))
    lip = shape.lower_lip[:1, :3] + (0, 0, shape.lower_lip[0, 3])
    assert skin_distance(shape, lip)[0] < 0.2 < skull_distance(recipe, lip)[0]


def test_frames_are_rotations_and_the_left_eye_turns_outwards():
    frame = eye_frame(load_recipe("teen"))
    assert np.allclose(frame @ frame.T, np.eye(3)) and np.linalg.det(frame) > 0
    assert frame[2, 0] > 0 and frame[0, 1] > 0
    assert np.allclose(np.array([0, 0, 1.0]) @ rotation_y(90), [1, 0, 0])


def test_head_offers_its_skull_as_a_distance():
    teen = head("teen")
    distances = teen.sdf(np.array([[0.0, 40, 0], [0, 40, 300]]))
    assert distances[0] < -20 and distances[1] > 100
