"""Folds: signed angles at edges, and the pose that folds a patch most, whatever else moves."""

import numpy as np
import pytest
from plane import flat_grid

from replicate.base.exceptions import InputError
from replicate.geometry.mesh import Mesh, edges, fold_angles, inner_edges, most_folded

TENT = np.float32([[0, -10, 0], [0, 10, 0], [-10, 0, 0], [10, 0, 0]])
TENT_FACES = np.int32([[0, 1, 2], [1, 0, 3]])


def sheet(n=8) -> Mesh:
    vertices, faces = flat_grid(5 * np.arange(n), 5 * np.arange(n))
    uv = vertices[:, :2] / vertices[:, :2].max()
    return Mesh(vertices, faces, uv, np.zeros(n * n, np.int32), ("sheet",))


@pytest.mark.parametrize("degrees", [-100.0, -30, 0, 5, 90])
def test_the_fold_of_a_tent_is_the_angle_between_its_sides(degrees):
    half = np.radians(degrees) / 2
    posed = TENT.copy()
    posed[2:, 0] = [-10 * np.cos(half), 10 * np.cos(half)]
    posed[2:, 2] = -10 * np.sin(half)
    ridge, sides = inner_edges(TENT_FACES)
    assert ridge.tolist() == [[0, 1]] and sides.tolist() == [[0, 1]]
    assert fold_angles(posed, TENT_FACES, ridge, sides)[0] == pytest.approx(degrees, abs=1e-3)


def test_inner_edges_are_all_edges_but_the_border():
    mesh = sheet()
    pairs, sides = inner_edges(mesh.faces)
    assert len(pairs) == len(edges(mesh.faces)) - 4 * 7
    shared = [len(set(mesh.faces[a]) & set(mesh.faces[b])) for a, b in sides]
    assert shared == [2] * len(pairs)


def test_the_most_folded_pose_is_not_the_most_moved_one():
    mesh = sheet()
    x = mesh.neutral[:, 0]
    t = np.radians(70)
    turned = mesh.neutral @ np.float32([[np.cos(t), 0, -np.sin(t)], [0, 1, 0], [np.sin(t), 0, np.cos(t)]]) + 50
    ripple = np.zeros_like(mesh.neutral)
    ripple[:, 2] = np.sin(x * 2) * 0.4
    offsets = np.stack([0 * x[:, None] + np.float32([200, 0, 0]), turned - mesh.neutral, ripple, ripple * 0.5])
    visible = np.ones(len(mesh.faces), bool)
    assert most_folded(mesh, np.arange(4), offsets, visible, batch=3) == 2
    assert most_folded(mesh, np.array([0, 3]), offsets, visible) == 3, "a pose that is not looked at is not chosen"


def test_folds_that_the_neutral_has_do_not_count():
    flat = sheet()
    ripple = flat.neutral + np.float32([0, 0, 2]) * np.sin(flat.neutral[:, :1] * 2)
    mesh = Mesh(ripple, flat.faces, flat.uv, flat.segment, flat.segment_names)
    offsets = np.stack([np.zeros_like(ripple), flat.neutral - ripple])
    assert most_folded(mesh, np.arange(2), offsets, np.ones(len(mesh.faces), bool)) == 1


def test_only_folds_of_the_shown_faces_count():
    mesh = sheet()
    left = mesh.neutral[mesh.faces].mean(1)[:, 0] < 12
    offsets = np.zeros((2, 64, 3), np.float32)
    offsets[0, mesh.neutral[:, 0] > 20, 2] = 3
    offsets[1, 9, 2] = 0.5
    both = np.arange(2)
    assert most_folded(mesh, both, offsets, left) == 1
    assert most_folded(mesh, both, offsets, ~left) == 0
    with pytest.raises(InputError, match="no two of the shown faces share an edge"):
        most_folded(mesh, both, offsets, np.zeros(len(mesh.faces), bool))
