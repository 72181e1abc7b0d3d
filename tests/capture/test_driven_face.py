"""A driven face: parameters within limits, and a rig whose skin an approximation gives."""

import numpy as np
import rigs
import torch

from data_recipes.rig import Rig
from replicate.capture.driven_face import ApproximatedRig, driven_params
from replicate.export.files import moving_parts
from replicate.inverse.control_points import Region
from replicate.inverse.ik_network import IkModel


def test_parameters_end_at_the_limits_of_their_controls():
    rig = rigs.rig("tiny")

    region = Region("face", np.arange(2), np.arange(len(rig.controls)))
    networks = IkModel([region], (4,), 0.2, np.zeros((2, 3)), np.ones((2, 2)), rig.default, rig.upper - rig.lower)
    torch.nn.init.constant_(networks.networks[0].output.bias, 1e3)
    params = driven_params(networks, np.zeros((3, 2, 3), np.float32), rig)
    np.testing.assert_array_equal(params, np.tile(rig.upper, (3, 1)))


def test_the_skin_is_the_approximations_and_props_go_with_it():
    rig, shift = rigs.rig("tiny"), np.float32([0, 3, 0])
    face = ApproximatedRig(rig, lambda params, truth: truth + shift)
    assert isinstance(face, Rig)
    poses = np.stack([rig.default, 0.3 * rig.upper, 0.5 * rig.upper]).astype(np.float32)
    np.testing.assert_allclose(face(poses), rig(poses) + shift, atol=1e-4)
    np.testing.assert_allclose(face(poses[1]), rig(poses[1]) + shift, atol=1e-4)
    moved = {name: vertices for name, vertices, *_ in face.pose_props(poses[1])}
    for name, vertices, *_ in rig.pose_props(poses[1]):
        np.testing.assert_allclose(moved[name], vertices + (0 if name.startswith("eye") else shift), atol=1e-3)
    rest, frames = moving_parts(face, poses)
    np.testing.assert_allclose(frames[0][2], rig(poses[2]) + shift, atol=1e-4)
    assert len(rest) == len(frames) == 1 + len(moved)
