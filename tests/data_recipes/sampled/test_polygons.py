"""Polygons cut into triangles: fans where a fan does, ears where it doesn't."""

import numpy as np
import pytest

from data_recipes.sampled.polygons import triangulate


def areas(flat: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the signed areas of triangles in the plane."""
    a, b, c = (flat[faces[:, k]] for k in range(3))
    return ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2


def star(rng: np.random.Generator, corners: int) -> np.ndarray:
    """Return a polygon around the origin whose corners have random distances from it, anticlockwise."""
    angle = 2 * np.pi * (np.arange(corners) + rng.uniform(0, 0.9, corners)) / corners
    return rng.uniform(0.05, 1, (corners, 1)) * np.stack([np.cos(angle), np.sin(angle)], 1)


def turned(rng: np.random.Generator, flat: np.ndarray) -> np.ndarray:
    """Return points of the plane somewhere in space."""
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return flat @ turn[:2] + rng.normal(size=3)


def whole(flat: np.ndarray) -> float:
    after = np.roll(flat, -1, axis=0)
    return float((flat[:, 0] * after[:, 1] - flat[:, 1] * after[:, 0]).sum() / 2)


def test_triangles_of_random_stars_fill_them_without_overlap():
    rng = np.random.default_rng(0)
    for trial in range(300):
        flat = star(rng, corners := 4 + trial % 40)
        cut = triangulate(turned(rng, flat), [np.roll(range(corners), trial).tolist()])
        found = areas(flat, cut.faces)
        assert len(found) == corners - 2 and (found > -1e-12).all()
        assert found.sum() == pytest.approx(whole(flat), rel=1e-9)


def test_a_spiral_is_filled_too():
    angle = np.linspace(0, 6 * np.pi, 60)
    arm = lambda radius: radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1)  # noqa: E731
    flat = np.concatenate([arm(2 + angle), arm(1 + angle)[::-1]])
    found = areas(flat, triangulate(np.c_[flat, np.zeros(120)], [range(120)]).faces) * np.sign(whole(flat))
    assert (found > 0).all() and found.sum() == pytest.approx(abs(whole(flat)))


def test_a_convex_polygon_is_a_fan_from_its_first_corner_and_triangles_keep_the_order_of_polygons():
    angle = np.linspace(0, 2 * np.pi, 6, endpoint=False)
    points = np.c_[np.cos(angle), np.sin(angle), 0.05 * np.cos(5 * angle)]  # not quite plane
    cut = triangulate(points, [[2, 3, 4, 5, 0, 1], [0, 1, 2], [5, 4, 3, 2]])
    assert cut.faces.tolist() == [[2, 3, 4], [2, 4, 5], [2, 5, 0], [2, 0, 1], [0, 1, 2], [5, 4, 3], [5, 3, 2]]
    assert cut.polygon.tolist() == [0, 0, 0, 0, 1, 2, 2]
    assert cut.corner[4:].tolist() == [[6, 7, 8], [9, 10, 11], [9, 11, 12]]


def test_a_polygon_that_crosses_itself_still_gets_its_triangles():
    angle = 4 * np.pi * np.arange(5) / 5
    cut = triangulate(np.c_[np.cos(angle), np.sin(angle), 0 * angle], [range(5)])
    assert len(cut.faces) == 3


def test_a_hole_that_a_bridge_joins_to_the_outside_stays_open():
    outer, inner = [(-2, -2), (2, -2), (2, 2), (-2, 2)], [(-1, -1), (-1, 1), (1, 1), (1, -1)]
    flat = np.array(outer + inner, float)
    cut = triangulate(np.c_[flat, np.zeros(8)], [[0, 1, 2, 3, 0, 4, 5, 6, 7, 4]])
    assert all(len(set(face)) == 3 for face in cut.faces.tolist())
    assert areas(flat, cut.faces).sum() == pytest.approx(12) and (areas(flat, cut.faces) >= 0).all()


def test_only_the_first_of_polygons_with_the_same_vertices_counts():
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    cut = triangulate(points, [[0, 1, 2, 3], [3, 2, 1, 0], [0, 1, 2], [1, 2, 3, 0]])
    assert cut.polygon.tolist() == [0, 0, 2] and cut.repeated == 2
