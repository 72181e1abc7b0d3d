"""Deformation transfer: exact for what moves the original as a whole, and for any pose of the very same mesh."""

import numpy as np
import pytest
from plane import plane
from scipy.spatial.transform import Rotation

from replicate.base.exceptions import InputError
from replicate.transfer.deformation_transfer import DeformationTransfer, counterparts, frames

TURN = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
SHEAR = np.array([[1.3, 0.2, 0], [0, 0.7, -0.4], [0.1, 0, 1.1]])


def bowl(rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """A curved grid over the same square, whatever its number of vertices."""
    vertices, faces = plane(rows, columns)
    vertices[:, :2] *= 8 / vertices[:, :2].max(0)
    vertices[:, 2] = 0.1 * (vertices[:, 0] ** 2 + vertices[:, 1] * vertices[:, 0])
    return vertices, faces


def of(source, target) -> DeformationTransfer:
    return DeformationTransfer(*source, *target, counterparts(*target, *source))


@pytest.mark.parametrize("scale", [1.0, 1.7])
def test_a_turned_moved_and_scaled_original_takes_any_new_mesh_with_it(scale):
    source, target = bowl(9, 8), bowl(5, 6)

    def motion(x):
        return scale * x @ TURN + [5, -3, 2]

    moved = of(source, target)(motion(source[0])[None], motion(target[0])[None])
    np.testing.assert_allclose(moved[0], motion(target[0]), atol=1e-4)


def test_the_same_mesh_follows_an_affine_map_and_any_other_pose_exactly():
    source = bowl(6, 7)
    bent = source[0] + np.sin(source[0][:, [1, 2, 0]]) * [0.5, 1, 2]
    posed = np.stack([source[0] @ SHEAR + [1, 2, 3], bent])
    np.testing.assert_allclose(of(source, source)(posed, posed), posed, atol=1e-4)


def test_the_expected_vertices_decide_the_translation_of_each_part_and_nothing_else():
    vertices, faces = bowl(4, 4)
    two = np.concatenate([vertices, vertices + np.array([20, 0, 0])]), np.concatenate([faces, faces + len(vertices)])
    first = np.arange(len(two[0])) < len(vertices)
    bent = two[0] @ SHEAR
    noise = np.random.default_rng(0).normal(size=bent.shape)
    for part in (first, ~first):
        noise[part] -= noise[part].mean(0)
    expected = bent + noise + np.where(first[:, None], [1, 0, 0], [0, 2, 0])
    moved = of(two, two)(bent[None], expected[None])[0]
    np.testing.assert_allclose(moved[first], bent[first] + [1, 0, 0], atol=1e-4)
    np.testing.assert_allclose(moved[~first], bent[~first] + [0, 2, 0], atol=1e-4)


@pytest.mark.parametrize(("rows", "columns"), [(8, 10), (15, 14)])
def test_a_new_mesh_of_the_same_surface_moves_nearly_as_the_surface_does(rows, columns):
    source, target = bowl(12, 12), bowl(rows, columns)

    def bump(x):
        return x + np.exp(-((x[:, :2] - [3, 5]) ** 2).sum(1) / 5)[:, None] * [0.5, -0.3, 0.8]

    transfer, truth = of(source, target), np.stack([bump(target[0]), bump(target[0] @ TURN)])
    posed = np.stack([bump(source[0]), bump(source[0] @ TURN)])
    moved = transfer(posed, truth)
    error, travel = (np.linalg.norm(x, axis=-1).mean(1) for x in (moved - truth, truth - [target[0], target[0] @ TURN]))
    assert (error > 0).all() and (error < 0.2 * travel).all()
    one_by_one = [transfer(posed[k : k + 1], truth[k : k + 1])[0] for k in range(2)]
    np.testing.assert_allclose(moved, one_by_one, atol=1e-5)


def test_a_frame_has_two_edges_and_the_normal_at_their_scale():
    frame = frames(np.array([[0.0, 0, 0], [3, 0, 0], [0, 3, 0]]), np.array([[0, 1, 2]]))
    np.testing.assert_allclose(frame, [[[3, 0, 0], [0, 3, 0], [0, 0, 3]]])


def test_a_face_without_a_counterpart_is_refused():
    source = bowl(4, 4)
    with pytest.raises(InputError, match="expected one for each of the new mesh's 18 faces, got 17"):
        DeformationTransfer(*source, *source, np.zeros(17, int))
