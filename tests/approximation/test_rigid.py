"""Eq. 3 and Eq. 4 against closed forms and against quaternions."""

import numpy as np
import pytest

from replicate.approximation.rigid import (
    CHUNK,
    Attachments,
    attach,
    find_attachments,
    following_errors,
    placement_errors,
    segment_errors,
    without,
)
from replicate.base.exceptions import InputError
from replicate.geometry.alignment import align, nearest_rotation
from replicate.geometry.mesh import Mesh


def rotation_about(axis, angle_rad):
    """Rodrigues' formula for row vectors: the matrix that turns v into v @ R."""
    x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return (np.eye(3) + np.sin(angle_rad) * cross + (1 - np.cos(angle_rad)) * cross @ cross).T


def horn(source, target):
    """Horn's closed form by unit quaternions, 1987: the rotation of row vectors, without any singular values."""
    a, b = source - source.mean(0), target - target.mean(0)
    s = a.T @ b
    key = np.empty((4, 4))
    key[0, 0] = np.trace(s)
    key[0, 1:] = key[1:, 0] = s[1, 2] - s[2, 1], s[2, 0] - s[0, 2], s[0, 1] - s[1, 0]
    key[1:, 1:] = s + s.T - np.trace(s) * np.eye(3)
    w, x, y, z = np.linalg.eigh(key)[1][:, -1]
    column = np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )
    return column.T


def test_a_known_rigid_motion_is_recovered_for_every_pose_of_a_batch():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(9, 3)) * 20
    turns = np.stack([rotation_about(rng.normal(size=3), a) for a in (0.0, 1e-6, 0.4, 2.0, np.pi)])
    shifts = rng.normal(size=(5, 3)) * 30
    rotation, translation = align(points, points @ turns + shifts[:, None])
    np.testing.assert_allclose(rotation, turns, atol=1e-10)
    np.testing.assert_allclose(translation, shifts, atol=1e-8)


def test_noisy_points_give_the_rotation_that_quaternions_give():
    rng = np.random.default_rng(1)
    for _ in range(50):
        source, target = rng.normal(size=(2, 6, 3))
        np.testing.assert_allclose(align(source, target)[0], horn(source, target), atol=1e-9)


def test_a_mirror_image_gets_a_proper_rotation_and_the_best_one():
    rng = np.random.default_rng(2)
    source = rng.normal(size=(12, 3)) * [5, 3, 1]
    target = source * [1, 1, -1]
    rotation, translation = align(source, target)
    assert np.linalg.det(rotation) == pytest.approx(1)
    best = ((source @ rotation + translation - target) ** 2).sum()
    for _ in range(300):
        nudged = rotation @ rotation_about(rng.normal(size=3), rng.normal() * 0.3)
        centred = (source - source.mean(0)) @ nudged - (target - target.mean(0))
        assert (centred**2).sum() >= best - 1e-9


def test_points_on_a_line_take_the_smallest_rotation_that_fits():
    source = np.arange(5)[:, None] * np.array([1.0, 0.0, 0.0])
    turn = rotation_about([0, 0, 1], 0.7)
    rotation, _ = align(source, source @ turn)
    np.testing.assert_allclose(rotation, turn, atol=1e-6)


def test_points_in_one_place_only_translate():
    source = np.tile([3.0, 4.0, 5.0], (4, 1))
    rotation, translation = align(source, source + np.array([1, 2, 3]))
    np.testing.assert_allclose(rotation, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(translation, [1, 2, 3], atol=1e-12)


def test_nearest_rotation_of_zero_is_the_identity():
    np.testing.assert_allclose(nearest_rotation(np.zeros((2, 3, 3))), np.stack([np.eye(3)] * 2))


def grid_mesh(names=("skin", "tooth", "wobbly")):
    """Skin of 7 × 7 vertices, a cube-like tooth of 8 and a third segment of 8 that bends."""
    x, y = np.meshgrid(np.arange(7.0), np.arange(7.0), indexing="ij")
    skin = np.stack([x.ravel() * 5, y.ravel() * 5, 0 * x.ravel()], -1)
    cube = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)], float) * 2
    neutral = np.concatenate([skin, cube + np.array([10, 10, -5]), cube + np.array([25, 25, -5])]).astype(np.float32)
    segment = np.repeat([0, 1, 2], [49, 8, 8]).astype(np.int32)
    corner = np.array([[i, i + 1, i + 7] for i in range(40) if i % 7 < 6])
    faces = np.concatenate([corner, [[49, 50, 51], [52, 53, 54], [57, 58, 59], [60, 61, 62]]]).astype(np.int32)
    uv = (neutral[:, :2] - neutral[:, :2].min(0)) / np.ptp(neutral[:, :2], axis=0)
    return Mesh(neutral=neutral, faces=faces, uv=uv.astype(np.float32), segment=segment, segment_names=names)


def moving_poses(mesh, count=30, seed=4):
    """The lower-left 4 × 4 of the skin turns with the tooth; the rest bends, and so does the third segment."""
    rng = np.random.default_rng(seed)
    poses = np.repeat(mesh.neutral[None].astype(np.float64), count, 0)
    carriers = (mesh.neutral[:, :2] <= 15).all(1) & (mesh.segment == 0)
    with_tooth = carriers | (mesh.segment == 1)
    for pose in poses:
        turn = rotation_about(rng.normal(size=3), rng.normal() * 0.3)
        pose[with_tooth] = pose[with_tooth] @ turn + rng.normal(size=3) * 4
        bend = ~with_tooth
        pose[bend] += rng.normal(size=(bend.sum(), 3))
    return poses.astype(np.float32), carriers


def test_only_the_segment_that_moves_rigidly_is_found_and_its_carriers_are_those_that_move_with_it():
    mesh = grid_mesh()
    poses, carriers = moving_poses(mesh)
    attachments = find_attachments(mesh, poses)
    assert attachments.segment.tolist() == [1]
    assert attachments.vertex.shape == (1, 10) and carriers[attachments.vertex].all()
    assert len(set(attachments.vertex[0])) == 10
    assert attachments.error_mm.max() < 1e-4 and attachments.rigid_error_mm.max() < 1e-4


def test_how_badly_a_vertex_follows_is_the_root_of_equation_4():
    mesh = grid_mesh()
    poses, _ = moving_poses(mesh)
    rotation, translation = align(mesh.neutral[mesh.segment == 1], poses[:, mesh.segment == 1])
    distance = np.linalg.norm(mesh.neutral @ rotation + translation[:, None] - poses, axis=-1)
    expected = np.sqrt((distance**2).mean(0))
    every, tooth = np.arange(len(mesh.neutral)), np.array([1])
    np.testing.assert_allclose(following_errors(mesh, every, tooth, poses)[0], expected, atol=1e-4)
    assert expected.max() > 1


def test_the_threshold_is_a_length_and_does_not_depend_on_how_many_vertices_a_segment_has():
    mesh = grid_mesh()
    poses, _ = moving_poses(mesh)
    rng = np.random.default_rng(5)
    noisy = poses + (rng.normal(size=poses.shape) * 0.2 / np.sqrt(3)).astype(np.float32)
    tooth = segment_errors(mesh, noisy)[:, 1].mean()
    # 8 vertices have 24 coordinates, of which a rigid motion absorbs 6
    assert tooth == pytest.approx(0.2 * np.sqrt(18 / 24), rel=0.1)
    assert find_attachments(mesh, noisy, tau_mm=0.3).segment.tolist() == [1]
    assert find_attachments(mesh, noisy, tau_mm=0.1).segment.tolist() == []


@pytest.mark.parametrize("still, rigid", [(3, False), (39, True)])
def test_a_segment_is_rigid_by_the_mean_of_its_errors_over_poses(still, rigid):
    mesh = grid_mesh()
    poses = np.repeat(mesh.neutral[None], still + 1, 0)
    skin = poses[:, mesh.segment == 0]
    poses[:, mesh.segment == 0] = skin + np.random.default_rng(8).normal(size=skin.shape).astype(np.float32)
    tooth = mesh.neutral[mesh.segment == 1]
    poses[-1, mesh.segment == 1] = tooth.mean(0) + 3 * (tooth - tooth.mean(0))  # grown threefold, its radius is √3 mm
    assert segment_errors(mesh, poses)[:, 1].mean() == pytest.approx(2 * np.sqrt(3) / (still + 1), rel=1e-4)
    assert (1 in find_attachments(mesh, poses).segment) == rigid


def test_attach_places_a_rigid_segment_from_its_carriers_alone():
    mesh = grid_mesh()
    poses, _ = moving_poses(mesh)
    attachments = find_attachments(mesh, poses[:20])
    predicted = poses[20:].copy()
    predicted[:, mesh.segment == 1] = np.nan
    placed = attach(mesh, attachments, predicted)
    assert placed.dtype == np.float32
    np.testing.assert_allclose(placed, poses[20:], atol=1e-3)
    np.testing.assert_array_equal(placed[:, mesh.segment != 1], predicted[:, mesh.segment != 1])
    moved = np.linalg.norm(poses[20:] - mesh.neutral, axis=-1)[:, mesh.segment == 1]
    assert moved.mean(1).min() > 0.1, "a tooth that stays would be placed well by doing nothing"


def test_noise_on_the_carriers_moves_a_placement_as_their_spread_says():
    mesh = grid_mesh()
    poses, _ = moving_poses(mesh, count=400)
    attachments = find_attachments(mesh, poses[:30])
    noise = 0.1
    rng = np.random.default_rng(6)
    placed = attach(mesh, attachments, poses + (rng.normal(size=poses.shape) * noise).astype(np.float32))
    # small rotations by least squares: covariance noise²/c · inertia⁻¹ about the carriers' centre, plus the mean's
    rest = mesh.neutral[attachments.vertex[0]].astype(float)
    centred = rest - rest.mean(0)
    inertia = np.eye(3) * (centred**2).sum() - centred.T @ centred
    lever = mesh.neutral[mesh.segment == 1] - rest.mean(0)
    spread = np.linalg.inv(inertia)
    expected = [np.trace(np.eye(3) / 10 + skew(r) @ spread @ skew(r).T) for r in lever]
    observed = ((placed - poses)[:, mesh.segment == 1] ** 2).sum(-1).mean()
    assert observed == pytest.approx(noise**2 * np.mean(expected), rel=0.15)
    assert attachments.spread_mm[0, 2] < 1e-5 < attachments.spread_mm[0, 1]


def skew(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def test_a_mesh_without_rigid_segments_gives_no_attachments_and_attach_changes_nothing():
    mesh = grid_mesh()
    poses = mesh.neutral + np.random.default_rng(7).normal(size=(5, len(mesh.neutral), 3)).astype(np.float32)
    attachments = find_attachments(mesh, poses)
    assert attachments.vertex.shape == (0, 10)
    np.testing.assert_array_equal(attach(mesh, attachments, poses), poses)


def test_too_few_deformable_vertices_are_an_input_error():
    mesh = grid_mesh()
    still = np.repeat(mesh.neutral[None], 3, 0)
    with pytest.raises(InputError, match=r"expected at least 10 deformable vertices .*, got 0"):
        find_attachments(mesh, still)


def test_attachments_come_back_from_disk_as_they_were(tmp_path):
    mesh = grid_mesh()
    attachments = find_attachments(mesh, moving_poses(mesh)[0])
    attachments.save(tmp_path / "rigid.npz")
    for name, array in vars(Attachments.load(tmp_path / "rigid.npz")).items():
        np.testing.assert_array_equal(array, getattr(attachments, name))


def eye_poses(turns=300, still=300):
    """Poses in which the second segment turns by itself in still skin, in as many as the first number says."""
    mesh, rng = grid_mesh(), np.random.default_rng(9)
    poses = np.repeat(mesh.neutral[None].astype(np.float64), turns + still, 0)
    eye = mesh.segment == 1
    centre = mesh.neutral[eye].mean(0)
    for pose in poses[:turns]:
        pose[eye] = (pose[eye] - centre) @ rotation_about(rng.normal(size=3), 0.4) + centre
    bent = (mesh.segment == 2) | (mesh.segment == 0) & (mesh.neutral[:, 0] > 15)
    poses[:, bent] += rng.normal(size=(turns + still, bent.sum(), 3))
    return mesh, poses.astype(np.float32)


def test_a_segment_that_turns_in_still_skin_is_rigid_and_has_no_vertices_that_would_place_it():
    mesh, poses = eye_poses()
    attachments = find_attachments(mesh, poses)
    assert attachments.segment.tolist() == [1]
    (error,) = placement_errors(mesh, attachments, poses)
    members = np.flatnonzero(mesh.segment == 1)
    turned = np.sqrt(((poses[:300, members] - mesh.neutral[members]) ** 2).sum(-1).mean(-1))
    assert error == pytest.approx(turned.mean(), rel=1e-3), "left where it rests, it is off by all of its motion"
    assert error > 0.3
    assert len(without(attachments, [1]).segment) == 0 and len(without(attachments, [0]).segment) == 1


@pytest.mark.parametrize("turns", [1, 10])
def test_a_segment_that_seldom_moves_is_judged_by_the_poses_that_move_it(turns):
    mesh, poses = eye_poses(turns, 400 - turns)
    often = placement_errors(mesh, find_attachments(mesh, poses), poses)
    assert often[0] > 0.3, "the mean over all poses is far below that"


def test_a_segment_that_its_carriers_move_with_is_placed_well():
    mesh = grid_mesh()
    poses, _ = moving_poses(mesh)
    assert placement_errors(mesh, find_attachments(mesh, poses), poses).max() < 1e-3


def test_poses_may_be_more_than_are_looked_at_at_a_time():
    mesh = grid_mesh()
    poses, _ = moving_poses(mesh, CHUNK + 7)
    whole, parts = (following_errors(mesh, np.arange(49), np.array([1]), poses[:k]) for k in (CHUNK + 7, CHUNK))
    rest = following_errors(mesh, np.arange(49), np.array([1]), poses[CHUNK:])
    np.testing.assert_allclose(whole**2 * (CHUNK + 7), parts**2 * CHUNK + rest**2 * 7, rtol=1e-9)


def test_a_segment_that_is_named_is_rigid_whatever_equation_3_says():
    mesh = grid_mesh()
    poses, _ = moving_poses(mesh)
    assert find_attachments(mesh, poses, named=[2]).segment.tolist() == [1, 2]
