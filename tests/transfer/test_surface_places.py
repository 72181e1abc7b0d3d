"""Places on a surface: shares of corners that sum to 1, the nearest of all places, and values carried over exactly."""

import numpy as np
import pytest
from plane import flat_grid, plane

from replicate.transfer.surface_places import Places, closest_shares, nearest_faces, nearest_places

RNG = np.random.default_rng(0)


def test_a_place_has_positive_shares_that_sum_to_one_and_is_the_nearest_of_many_points():
    vertices, faces = bumpy()
    points = RNG.uniform((-1, -1, -2), (6, 7, 3), (40, 3))
    places = nearest_places(points, vertices, faces)
    assert (places.shares >= 0).all()
    np.testing.assert_allclose(places.shares.sum(1), 1, atol=1e-12)
    found = np.linalg.norm(places.mix(vertices) - points, axis=1)
    shares = RNG.dirichlet(np.full(3, 0.5), 400)
    others = np.einsum("sc,fcx->fsx", shares, vertices[faces]).reshape(-1, 3)
    tried = np.linalg.norm(points[:, None] - others, axis=2).min(1)
    assert (found <= tried + 1e-12).all() and (tried - found).max() < 0.4


def test_points_on_the_surface_are_given_back():
    vertices, faces = bumpy()
    face, shares = RNG.integers(len(faces), size=60), RNG.dirichlet(np.ones(3), 60)
    points = Places(faces[face], shares).mix(vertices)
    assert (nearest_faces(points, vertices, faces) == face).all()
    places = nearest_places(points, vertices, faces)
    np.testing.assert_allclose(places.shares, shares, atol=1e-9)
    np.testing.assert_allclose(places.mix(vertices), points, atol=1e-12)


def test_vertices_are_their_own_places():
    vertices, faces = bumpy()
    places = nearest_places(vertices, vertices, faces)
    assert (places.nearest_corner == np.arange(len(vertices))).all()
    np.testing.assert_array_equal(places.mix(vertices), vertices)


@pytest.mark.parametrize(
    ("point", "shares"),
    [
        ((0.25, 0.25, 3), (0.5, 0.25, 0.25)),
        ((-1, -1, 0), (1, 0, 0)),
        ((0.5, -2, 0), (0.5, 0.5, 0)),
        ((1, 1, 1), (0, 0.5, 0.5)),
        ((5, -1, 0), (0, 1, 0)),
    ],
)
def test_beside_a_triangle_the_nearest_point_is_on_its_edge_or_corner(point, shares):
    corners = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    np.testing.assert_allclose(closest_shares(np.array([point], float), corners), [shares], atol=1e-12)


def test_a_triangle_without_area_gives_the_nearest_point_of_its_edges():
    corners = np.array([[[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]])
    shares = closest_shares(np.array([[1.5, 1, 0]]), corners)
    np.testing.assert_allclose(np.einsum("c,cx->x", shares[0], corners[0]), [1.5, 0, 0])


def test_a_point_between_two_sheets_lands_on_the_one_that_faces_as_it_does():
    ticks = np.linspace(0, 4, 5)
    (upper, faces), (lower, _) = flat_grid(ticks, ticks, 0.2), flat_grid(ticks, ticks, 0.0)
    both = np.concatenate([lower, upper])
    sheets = np.concatenate([faces, faces[:, ::-1] + len(lower)])  # the lower one faces up, the upper one down
    points = np.array([[1.3, 2.2, 0.15], [1.3, 2.2, 0.05]])
    up = np.array([[0.0, 0, 1], [0, 0, 1]])
    heights = [nearest_places(points, both, sheets, d).mix(both)[:, 2].tolist() for d in (None, up, -up)]
    np.testing.assert_allclose(heights, [[0.2, 0], [0, 0], [0.2, 0.2]], atol=1e-6)
    aside = np.array([[1.0, 0, 0], [0, 0, 1]])
    assert nearest_places(points, both, sheets, aside).mix(both)[0, 2] == pytest.approx(0.2), "nothing faces there"


def test_a_point_whose_facing_sheet_is_far_takes_the_near_one_with_a_lead():
    ticks = np.linspace(0, 4, 5)
    (near, faces), (far, _) = flat_grid(ticks, ticks, 0.0), flat_grid(ticks, ticks, 9.0)
    both = np.concatenate([near, far])
    sheets = np.concatenate([faces, faces[:, ::-1] + len(near)])  # the near one faces up, the far one down
    point, down = np.array([[1.3, 2.2, 1.0]]), np.array([[0.0, 0, -1]])
    heights = [nearest_places(point, both, sheets, down, lead).mix(both)[0, 2] for lead in (6.0, 8.0, np.inf)]
    np.testing.assert_allclose(heights, [0, 9, 9], atol=1e-6)


def test_many_poses_are_mixed_as_each_is():
    vertices, faces = bumpy()
    places = nearest_places(RNG.uniform(0, 4, (7, 3)), vertices, faces)
    poses = RNG.normal(size=(3, len(vertices), 3)).astype(np.float32)
    mixed = places.mix(poses)
    assert mixed.dtype == np.float32 and mixed.shape == (3, 7, 3)
    np.testing.assert_array_equal(mixed[1], places.mix(poses[1]))


def bumpy() -> tuple[np.ndarray, np.ndarray]:
    """A jittered grid whose heights vary, with triangles of many sizes and tilts."""
    vertices, faces = plane(7, 6)
    vertices[:, 2] = np.random.default_rng(1).uniform(0, 1, len(vertices))
    return vertices, faces
