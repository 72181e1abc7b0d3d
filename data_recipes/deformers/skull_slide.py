"""Skin slides along the skull: X −= w (d − d₀) ∇d (layer 2).

Near each resting vertex, the skull's signed distance is approximated by its quadratic Taylor polynomial, taken once
from the SDF with differences wide enough to see bone and not pores. So the layer is a handful of products per vertex,
and accurate for slides of up to about a third of the local radius of curvature.
"""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from data_recipes.deformers.node_chain import Constants, Values, place_of, spread

STEP_MM = 4.0
TIGHTEST_MM = 22.0  # tighter radii of curvature are features such as a nose wing, which skin doesn't slide over


def quadratic_model(
    sdf: Callable[[np.ndarray], np.ndarray], points: Float[np.ndarray, "s 3"]
) -> tuple[Float[np.ndarray, "s 3"], Float[np.ndarray, "s 3 3"]]:
    """Return the unit gradient and the Hessian (1/mm) of a signed distance at points, by central differences."""
    s = len(points)
    offsets = [np.zeros(3)]
    axes = np.eye(3) * STEP_MM
    offsets += [sign * axes[i] for i in range(3) for sign in (1, -1)]
    pairs = [(0, 1), (0, 2), (1, 2)]
    offsets += [p * axes[i] + q * axes[j] for i, j in pairs for p in (1, -1) for q in (1, -1)]
    values = sdf((points[None] + np.array(offsets)[:, None]).reshape(-1, 3)).reshape(len(offsets), s)
    gradient = np.stack([(values[1 + 2 * i] - values[2 + 2 * i]) / (2 * STEP_MM) for i in range(3)], axis=1)
    hessian = np.zeros((s, 3, 3))
    for i in range(3):
        hessian[:, i, i] = (values[1 + 2 * i] - 2 * values[0] + values[2 + 2 * i]) / STEP_MM**2
    for k, (i, j) in enumerate(pairs):
        pp, pm, mp, mm = values[7 + 4 * k : 11 + 4 * k]
        hessian[:, i, j] = hessian[:, j, i] = (pp - pm - mp + mm) / (4 * STEP_MM**2)
    gradient /= np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 1e-9)
    # Only the tangential part is curvature. At a crease it may be huge, so clamp it.
    tangent = np.eye(3) - gradient[:, :, None] * gradient[:, None, :]
    values, vectors = np.linalg.eigh(tangent @ hessian @ tangent)
    values = np.clip(values, -1 / TIGHTEST_MM, 1 / TIGHTEST_MM)
    return gradient, (vectors * values[:, None]) @ vectors.transpose(0, 2, 1)


def prepare(
    sdf: Callable[[np.ndarray], np.ndarray], neutral: Float[np.ndarray, "n 3"], weight: Float[np.ndarray, " n"]
) -> dict[str, np.ndarray]:
    """Return the slide's constants for the vertices where `weight` (0 free … 1 glued to the skull) is above 0."""
    support = np.flatnonzero(weight > 1e-3)
    gradient, hessian = quadratic_model(sdf, neutral[support])
    upper = hessian[:, [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    return {
        "support": support.astype(np.int32),
        "place": place_of(support, len(neutral)),
        "gradient": gradient.T.astype(np.float32),
        "hessian": upper.T.astype(np.float32),
        "weight": weight[support].astype(np.float32),
    }


def slide(constants: Constants, offset: Float[Values, "b 3 n"]) -> Float[Values, "b 3 n"]:
    """Return what to add to offsets from the neutral so that the skin keeps its distance from the skull."""
    t = offset[:, :, constants["support"]]
    gradient = constants["gradient"]
    xx, yy, zz, xy, xz, yz = constants["hessian"]
    x, y, z = t[:, 0], t[:, 1], t[:, 2]
    hx, hy, hz = xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z
    gx, gy, gz = gradient[0] + hx, gradient[1] + hy, gradient[2] + hz
    # d − d₀ to second order, from the gradient half-way, g + ½Ht.
    change = (gradient[0] + 0.5 * hx) * x + (gradient[1] + 0.5 * hy) * y + (gradient[2] + 0.5 * hz) * z
    scale = -constants["weight"] * change / (gx * gx + gy * gy + gz * gz)
    shift = scale[:, None] * jnp.stack([gx, gy, gz], axis=1)
    return spread(shift, constants["place"])
