"""Exact derivatives of a rig along directions: those of its Jacobian."""

import jax.numpy as jnp
import numpy as np
from box import MESH, foreign

from replicate.methods.regional import derivative_batches


def test_they_are_the_jacobians_products_with_the_directions():
    rig = foreign(function=lambda p: jnp.asarray(MESH.neutral) + jnp.sin(p[:, :1, None]) * p[:, 1:, None] * 5.0)
    params, directions = np.random.default_rng(0).uniform(-1, 1, (2, 33, 2)).astype(np.float32)
    found = np.concatenate(list(derivative_batches(rig.function, params, directions)))
    exact = [rig.jacobian(pose) @ direction for pose, direction in zip(params, directions, strict=True)]
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, exact, atol=1e-5)
