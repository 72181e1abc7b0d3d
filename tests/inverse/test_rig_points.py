"""The rig's control points as a torch function: its numbers and its exact derivative."""

import numpy as np
import rigs
import torch

from replicate.inverse.posing import RigPoints


def test_the_rigs_points_and_derivatives_are_those_of_the_rig():
    rig = rigs.rig("tiny")
    vertices = np.asarray(rig.control_points)
    rng = np.random.default_rng(0)
    pose = (rig.default + 0.2 * rng.uniform(0, 1, len(rig.controls)) * (rig.upper - rig.default)).astype(np.float32)
    params = torch.from_numpy(pose[None].repeat(2, 0)).requires_grad_(True)
    reached = RigPoints(rig, vertices)(params)
    np.testing.assert_allclose(reached[1].detach().numpy(), rig(pose)[vertices], atol=1e-4)
    weights = rng.normal(size=reached.shape).astype(np.float32)
    (reached * torch.from_numpy(weights)).sum().backward()
    exact = rig.jacobian(pose)[vertices]
    expected = np.einsum("cd,cdm->m", weights[1], exact)
    np.testing.assert_allclose(params.grad[1].numpy(), expected, atol=1e-3 * np.abs(expected).max())
