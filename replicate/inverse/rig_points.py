"""The true rig at its control points, as a function that torch differentiates: what no closed rig allows (§4).

The paper replaces the rig in Eq. 6 by its approximation, since a production rig has no derivative. Ours have one, so
that inverse kinematics through the rig itself shows what a better approximation could bring at most.
"""

import functools
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

        self._points = jax.jit(points)
        # The second value is the derivative's function, with what it needs of the first pass: the rig runs once.
        self._linearise = jax.jit(lambda params: jax.vjp(points, params))

    def __call__(self, params: Float[torch.Tensor, "b m"]) -> Float[torch.Tensor, "b c 3"]:
        if torch.is_grad_enabled() and params.requires_grad:
            return _Bridge.apply(params, self._linearise)
        return torch.from_numpy(np.array(self._points(_to_numpy(params))))


class _Bridge(torch.autograd.Function):
    @staticmethod
    def forward(ctx, params: torch.Tensor, linearise: Callable) -> torch.Tensor:
        reached, ctx.pull = linearise(_to_numpy(params))
        return torch.from_numpy(np.array(reached))

    @staticmethod
    def backward(ctx, upstream: torch.Tensor) -> tuple:
        return torch.from_numpy(np.array(_compiled_pull()(ctx.pull, upstream.numpy()))), None


@functools.cache
def _compiled_pull() -> Callable:
    import jax

    return jax.jit(lambda pull, upstream: pull(upstream)[0])


def _to_numpy(params: torch.Tensor) -> np.ndarray:
    return params.detach().numpy().astype(np.float32)


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
