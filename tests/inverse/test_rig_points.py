"""The rig's control points as a torch function: its numbers and its exact derivative."""

import jax.numpy as jnp
import numpy as np
import torch
from small_face import small_mesh

from data_recipes.controls import Control
from data_recipes.function_rig import FunctionRig
from replicate.inverse.posing import RigPoints


def bent_rig() -> FunctionRig:
    """Return a rig of five controls, whose vertices move along parabolas and by products of controls."""
    mesh, rng = small_mesh(), np.random.default_rng(3)
    controls = tuple(Control(f"c{k}", -1.0, 0.25 * k - 0.5, 1.0, "face") for k in range(5))
    straight, curved = (rng.normal(size=(5, *mesh.neutral.shape)).astype(np.float32) for _ in range(2))

    def bend(params):
        away = params - jnp.asarray([control.default for control in controls])
        moved = jnp.tensordot(away, straight, 1) + jnp.tensordot(away * jnp.roll(away, 1, axis=1), curved, 1)
        return mesh.neutral + moved

    points = np.array([0, 7, 3], np.int32)
    return FunctionRig("bent", mesh, controls, points, points, ("face",) * 3, None, bend)


def test_the_rigs_points_and_derivatives_are_those_of_the_rig():
    rig = bent_rig()
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
