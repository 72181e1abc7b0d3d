"""Soft limits on controls, so that Eq. 5's factor 3 gives a stronger face and not an explosion."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from data_recipes.deformers.planes import Constants, Values

REACH = 1.3  # the furthest effective value, in units of the control's own limit
SLACK = 0.12  # how far a one-sided control gives way on its closed side
SHARPNESS = 6  # even; larger follows the identity longer


def limits(lower: np.ndarray, upper: np.ndarray, default: np.ndarray) -> dict[str, np.ndarray]:
    """Return the effective limits below and above each control's default, (m,) each, and the default."""
    above = REACH * (upper - default)
    below = REACH * (default - lower)
    return {
        "default": default.astype(np.float32),
        "below": np.where(below > 0, below, SLACK * above).astype(np.float32),
        "above": np.where(above > 0, above, SLACK * below).astype(np.float32),
    }


def saturate(limit: Constants, params: Float[Values, "b m"]) -> Float[Values, "b m"]:
    """Return p − default bent towards its limits: x (1 + (x/c)⁶)^(−1/6), the identity to sixth order at 0.

    c is the limit on x's side; below c/2 the change is under 0.3 %, and |result| < c up to |x| = 1000 c.
    """
    x = params - limit["default"]
    c = jnp.where(x < 0, limit["below"], limit["above"])
    # Clipping keeps the power finite for wild inputs.
    ratio = jnp.clip(x / c, -1e3, 1e3)
    return x * (1 + ratio**SHARPNESS) ** (-1 / SHARPNESS)


def hinge(x: Float[Values, "*s"], width: float | Values) -> Float[Values, "*s"]:
    """Return max(x, 0) with a quadratic start over `width`: exactly 0 below 0, x − width/2 beyond `width`, C¹."""
    y = jax.nn.relu(x)
    return jnp.where(y < width, y * y / (2 * width), y - width / 2)
