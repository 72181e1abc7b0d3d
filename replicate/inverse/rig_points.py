"""The true rig at its control points, as a function that torch differentiates: what no closed rig allows (§4).

The paper replaces the rig in Eq. 6 by its approximation, since a production rig has no derivative. Ours have one, so
that inverse kinematics through the rig itself shows what a better approximation could bring at most.
"""

from collections.abc import Callable

import numpy as np
import torch
from jaxtyping import Float, Float32, Int

from data_recipes.rig import Rig
from replicate.engine.exceptions import InputError


class RigPoints:
    """Raw rig parameters (b, m) → positions (b, c, 3) of some vertices in mm, differentiable in torch.

    rig: one with a `function` that JAX can trace. Raises InputError for one without a function.
    """

    def __init__(self, rig: Rig, vertices: Int[np.ndarray, " c"]):
        import jax

        check_function(rig)

        def points(params: jax.Array) -> jax.Array:
            return rig.function(params)[:, vertices]

        def pull(params: jax.Array, upstream: jax.Array) -> jax.Array:
            return jax.vjp(points, params)[1](upstream)[0]

        self._points, self._pull = jax.jit(points), jax.jit(pull)

    def __call__(self, params: Float[torch.Tensor, "b m"]) -> Float[torch.Tensor, "b c 3"]:
        return _Bridge.apply(params, self._points, self._pull)


class _Bridge(torch.autograd.Function):
    @staticmethod
    def forward(ctx, params: torch.Tensor, points: Callable, pull: Callable) -> torch.Tensor:
        ctx.array, ctx.pull = params.detach().numpy().astype(np.float32), pull
        return torch.from_numpy(np.array(points(ctx.array)))

    @staticmethod
    def backward(ctx, upstream: torch.Tensor) -> tuple:
        return torch.from_numpy(np.array(ctx.pull(ctx.array, upstream.numpy()))), None, None


def jacobian_at(rig: Rig, vertices: Int[np.ndarray, " c"]) -> Callable[[np.ndarray], Float32[np.ndarray, "c 3 m"]]:
    """Return (m,) → ∂V_C/∂p (c, 3, m), mm per unit of each control, exact, by reverse differentiation."""
    import jax

    check_function(rig)
    derivative = jax.jit(jax.jacrev(lambda p: rig.function(p[None])[0, vertices]))
    return lambda params: np.asarray(derivative(np.asarray(params, np.float32)))


def check_function(rig: Rig) -> None:
    """Raise InputError for a rig without a function that could be differentiated."""
    if not hasattr(rig, "function"):
        raise InputError(f"rig '{rig.name}': it has no `function` to differentiate; leave the rig itself out")
