"""The compiled rigid step against the clear one, on ordinary poses and where the carriers leave a freedom."""

import numpy as np
import pytest
from small_face import pose_offsets, small_mesh

from replicate.approximation.rigid import Attachments, attach
from replicate.inference.rigid_step import place_rigid_segments, plan_rigid_step

MESH = small_mesh()
RIGID = 2  # its third segment
ROUNDING = 4e-4  # radians: where only 1e-12 of a matrix settles the rotation, float64 leaves either way so much


def carried_by(vertices) -> Attachments:
    vertex = np.array([vertices])
    return Attachments(np.array([RIGID]), vertex, np.zeros(vertex.shape), np.zeros(1), np.ones((1, 3)))


def both(attachments, posed):
    """Return the pose by both ways; what it holds on the rigid segment is worth nothing."""
    posed = posed.astype(np.float32)
    posed[MESH.segment == RIGID] = 1e3
    fast = posed.copy()
    place_rigid_segments(plan_rigid_step(MESH, attachments), fast)
    return fast, attach(MESH, attachments, posed[None])[0]


def test_many_poses_are_those_of_the_clear_way():
    rng = np.random.default_rng(0)
    turned = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turned *= np.sign(np.linalg.det(turned))
    for k, offsets in enumerate(pose_offsets(MESH, rng.uniform(-1, 1, (200, 12)))):
        attachments = carried_by(rng.permutation(256)[:8])
        posed = MESH.neutral + offsets + rng.normal(size=offsets.shape) * (k % 3)
        fast, clear = both(attachments, posed @ turned if k % 2 else posed)
        np.testing.assert_allclose(fast, clear, atol=1e-3)
        assert np.abs(clear - MESH.neutral)[MESH.segment == RIGID].max() > 1e-2


@pytest.mark.parametrize(
    "change",
    [
        lambda places: np.zeros_like(places),  # all in one place
        lambda places: places[:, :1] * np.array([1.0, 2.0, -1.0]),  # on a line
        lambda places: places * np.array([1.0, 1.0, 0.0]),  # flat
        lambda places: places * np.array([1.0, 1.0, -1.0]) + places[::-1] * 0.05,  # mirrored, but for some noise
        lambda places: -places * np.array([1.0, 2.0, 3.0]),  # turned inside out
    ],
    ids=["place", "line", "plane", "mirror", "inside out"],
)
def test_carriers_that_leave_a_freedom_give_the_same_rotation(change):
    rng = np.random.default_rng(1)
    vertices = rng.permutation(256)[:8]
    posed = MESH.neutral.copy()
    posed[vertices] = change(posed[vertices])
    fast, clear = both(carried_by(vertices), posed)
    lever = np.linalg.norm(MESH.neutral[MESH.segment == RIGID] - MESH.neutral[vertices].mean(0), axis=1).max()
    np.testing.assert_allclose(fast, clear, atol=ROUNDING * lever)


def test_carriers_on_a_line_at_rest_turn_no_more_than_they_must():
    vertices = np.arange(8)  # a row of the grid, bent along one axis
    posed = MESH.neutral @ np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    posed[vertices, 1:] = posed[vertices[::-1], 1:]
    fast, clear = both(carried_by(vertices), posed)
    np.testing.assert_allclose(fast, clear, atol=1e-3)


def test_without_rigid_segments_nothing_is_written():
    none = Attachments(np.zeros(0, int), np.zeros((0, 4), int), np.zeros((0, 4)), np.zeros(0), np.zeros((0, 3)))
    posed = MESH.neutral.copy()
    place_rigid_segments(plan_rigid_step(MESH, none), posed)
    np.testing.assert_array_equal(posed, MESH.neutral)
