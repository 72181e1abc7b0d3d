"""Posing (§5.3.1): the rig parameters that control points lead to, and how far an approximation is from the rig there.

Whether the mesh is where the user drags it is one question; whether the approximation is the rig there is another, and
the paper's Table 4 answers that one.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float32, Int

from data_recipes.rig import Rig
from replicate.base.exceptions import InputError
from replicate.inverse.control_points import ControlPoints


@dataclass(frozen=True)
class Posed:
    """What inverse kinematics makes of some configurations. params: (k, m). vertices: (k, n, 3), the rig's, mm."""

    params: np.ndarray
    vertices: np.ndarray


def pose(rig: Rig, params: Float[np.ndarray, "k m"]) -> Posed:
    """Return the rig at parameters that inverse kinematics gave."""
    return Posed(np.asarray(params, np.float32), rig(params))


def point_errors_mm(
    posed: Posed, targets: Float[np.ndarray, "k c 3"], points: ControlPoints, axes: int
) -> Float32[np.ndarray, "k c"]:
    """Return how far the rig's control points are from where they are wanted, mm, in the first `axes` coordinates."""
    apart = (posed.vertices[:, points.vertices] - targets)[..., :axes]
    return np.linalg.norm(apart, axis=-1).astype(np.float32)


def outside_share(rig: Rig, posed: Posed, points: ControlPoints) -> float:
    """Return the share of the driven parameters that lie outside their controls' limits."""
    driven = points.driven()
    values, slack = posed.params[:, driven], 1e-5 * (rig.upper - rig.lower)[driven]
    return float(((values < rig.lower[driven] - slack) | (values > rig.upper[driven] + slack)).mean())


# The true rig at its control points, as a function that torch differentiates; a closed rig allows none (§4).


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


def check_function(rig: Rig) -> None:
    """Raise InputError for a rig without a function that could be differentiated."""
    if not hasattr(rig, "function"):
        raise InputError(f"rig '{rig.name}': it has no `function` to differentiate; leave the rig itself out")
