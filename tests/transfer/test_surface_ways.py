"""Ways over a surface: two lips that touch are far apart by them, so that a new mesh never joins one to the other."""

import numpy as np

from replicate.geometry.mesh import Mesh
from replicate.transfer.deformation_transfer import counterparts
from replicate.transfer.remeshing import reach_of, remeshed
from replicate.transfer.surface_places import FAR_MM, Nearby, nearest_faces, surface_ways

COLUMNS, ROWS = 41, 10  # of vertices, and rows of each lip


def test_ways_are_those_along_edges_from_vertices_that_are_spread():
    vertices = np.float32([[0, 0, 0], [3, 0, 0], [3, 4, 0], [9, 4, 0], [9, 9, 9]])
    ways = surface_ways(vertices, np.int32([[0, 1, 2], [1, 3, 2]]), 3)
    np.testing.assert_allclose(ways[:4, 0], [0, 3, 5, np.sqrt(52) + 3], rtol=1e-6)
    np.testing.assert_allclose(ways[:4, 1], [np.sqrt(52) + 3, np.sqrt(52), 6, 0], rtol=1e-6)
    assert ways[2, 2] == 0 and (ways[4] == FAR_MM).all()


def test_a_point_of_the_upper_lip_is_put_on_it_although_the_lower_one_is_nearer():
    mesh, upper = lips()
    ways = surface_ways(mesh.neutral, mesh.faces)
    seam = np.flatnonzero(upper & (mesh.neutral[:, 1] == mesh.neutral[upper, 1].min()))
    points = mesh.neutral[seam] - np.float32([0, 0.6, 0])
    on_upper = upper[mesh.faces].all(1)
    assert not on_upper[nearest_faces(points, mesh.neutral, mesh.faces)].any(), "the case has a wrong answer"
    nearby = Nearby(ways[seam], ways, reach_of(mesh.neutral, mesh.faces))
    assert on_upper[nearest_faces(points, mesh.neutral, mesh.faces, nearby=nearby)].all()


def test_a_new_mesh_opens_its_lips_as_the_original_does():
    mesh, upper = lips()
    opened = np.where(upper[:, None], [0, 8, 0], [0, -8, 0]) * opening(mesh.neutral)[:, None]
    for share in (0.5, 0.25):
        new = remeshed(mesh, (0,), share)
        moved = new.places.mix(mesh.neutral + opened) - new.mesh.neutral
        edges = new.mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        torn = np.abs(moved[edges[:, 0], 1] - moved[edges[:, 1], 1]).max()
        assert torn < 8, "no edge reaches from one lip to the other"
        ways = surface_ways(mesh.neutral, mesh.faces)
        nearby = Nearby(new.places.mix(ways), ways, reach_of(mesh.neutral, mesh.faces))
        own = counterparts(new.mesh.neutral, new.mesh.faces, mesh.neutral, mesh.faces, nearby)
        follows = opened[mesh.faces[own]].mean(1)[:, 1]
        np.testing.assert_allclose(follows, moved[new.mesh.faces].mean(1)[:, 1], atol=2.5)


def lips() -> tuple[Mesh, np.ndarray]:
    """Return two lips, one a little over the other, joined at their ends, and which vertices are the upper's."""
    x, y = np.meshgrid(np.arange(COLUMNS), np.arange(ROWS), indexing="ij")
    places = np.stack([x, y, 0 * x], -1).reshape(-1, 3).astype(np.float32)
    number = np.arange(len(places)).reshape(COLUMNS, ROWS)
    lower = places * [1, -1, 1] - [0, 1, 0]
    over = np.float32([0, -2.0, 0.01]) * opening(places)[:, None]  # the upper lip's seam lies on the lower lip
    both = np.concatenate([places + over, lower]).astype(np.float32)
    both[:, 2] -= 0.02 * ((both[:, 0] - COLUMNS // 2) ** 2 + both[:, 1] ** 2)  # round as a face is
    sheets = [_sheet(number), _sheet(number + number.size)[:, ::-1]]
    seams = np.stack([number[:, 0], number[:, 0] + number.size], 1)
    joined = [_sheet(seams[:5])[:, ::-1], _sheet(seams[-5:])[:, ::-1]]
    uv = (both[:, :2] - both[:, :2].min(0)) / np.ptp(both[:, :2], axis=0)
    faces = np.concatenate([*sheets, *joined]).astype(np.int32)
    return Mesh(both, faces, uv, np.zeros(len(both), np.int32), ("face",)), np.arange(len(both)) < number.size


def opening(vertices: np.ndarray) -> np.ndarray:
    """Return how far the lips open above and below each place, from 0 at their ends to 1."""
    return np.sin(np.pi * ((vertices[:, 0] - 4) / (COLUMNS - 9)).clip(0, 1))


def _sheet(number: np.ndarray) -> np.ndarray:
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    return np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
