"""Pose interpolation on curves: sculpted fields, in-betweens, combination correctives (layer 1).

A face action moves each vertex along a parabola through the neutral (u = 0), the half pose and the full pose:
X += u·D₁ + 4u(1 − u)·D₂. A corrective adds its field times the product of two or three controls. All of it is linear in
the coefficients, so matrix products move the whole batch. Most fields move a small part of the face: there is one
product for each block of vertices that are moved by much the same fields.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from sklearn.cluster import KMeans

from data_recipes.deformers.node_chain import Constants, Values, place_of, spread

BLOCKS = 12  # of vertices
SMALLEST_BLOCK = 50  # vertices to a block, on average


@dataclass
class PoseFields:
    """Collect sculpted fields: for each a displacement (n, 3) in mm and the controls that drive it.

    Drivers are columns of p; a field with several is multiplied by each of them. `between` fields take 4u(1 − u)
    of their only driver.
    """

    n: int
    drivers: list[tuple[int, ...]] = field(default_factory=list)
    between: list[bool] = field(default_factory=list)
    vectors: list[np.ndarray] = field(default_factory=list)

    def add(self, drivers: tuple[int, ...], vectors: np.ndarray, between: bool = False) -> None:
        """Add a field, unless it is below a micrometre everywhere."""
        if np.abs(vectors).max() > 1e-3:
            self.drivers.append(drivers)
            self.between.append(between)
            self.vectors.append(np.asarray(vectors, np.float32))

    def add_path(self, driver: int, half: np.ndarray, full: np.ndarray) -> None:
        """Add the parabola whose offsets are `half` at u = ½ and `full` at u = 1."""
        self.add((driver,), full)
        self.add((driver,), half - 0.5 * full, between=True)

    def constants(self, columns: int) -> dict[str, np.ndarray]:
        """Return the arrays that `coefficients` and `move` need; `columns` is m.

        factor: (k, 3), columns of [p, 1] whose product drives field k
        between: (k,), 1 where 4u(1 − u) does
        blocks: for each the fields that move it, (q,), and their displacements, (q, 3 s)
        place: (n,), from `node_chain.place_of`
        """
        if not self.vectors:
            return {
                "factor": np.zeros((0, 3), np.int32),
                "between": np.zeros(0, np.float32),
                "place": np.zeros(self.n, np.int32),
            }
        stacked = np.stack(self.vectors)
        support = np.flatnonzero(np.abs(stacked).max(axis=(0, 2)) > 1e-4)
        moved = np.abs(stacked[:, support]).max(axis=2) > 0
        blocks = [support[block] for block in alike(moved.T)]
        factor = np.array([list(d) + [columns] * (3 - len(d)) for d in self.drivers], np.int32)
        return {
            "factor": factor,
            "between": np.asarray(self.between, np.float32),
            "blocks": {f"{i:02d}": _block(stacked[:, vertices]) for i, vertices in enumerate(blocks)},
            "place": place_of(np.concatenate(blocks), self.n),
        }


def _block(vectors: Float[np.ndarray, "k s 3"]) -> dict[str, np.ndarray]:
    used = np.flatnonzero(np.abs(vectors).max(axis=(1, 2)) > 0)
    fields = np.ascontiguousarray(vectors[used].transpose(0, 2, 1)).reshape(len(used), -1)
    return {"used": used.astype(np.int32), "fields": fields}


def alike(moved: Bool[np.ndarray, "s k"]) -> list[Int[np.ndarray, " b"]]:
    """Return blocks of rows that are true in much the same columns, by k-means."""
    count = min(BLOCKS, max(1, len(moved) // SMALLEST_BLOCK))
    label = KMeans(count, n_init=1, random_state=0).fit_predict(moved.astype(np.float32))
    return [block for block in (np.flatnonzero(label == i) for i in range(count)) if len(block)]


def coefficients(constants: Constants, u: Float[Values, "b m"]) -> Float[Values, "b k"]:
    """Return each field's coefficient: u, 4u(1 − u), or a product of controls."""
    padded = jnp.concatenate([u, jnp.ones_like(u[:, :1])], axis=1)
    first, second, third = (padded[:, constants["factor"][:, i]] for i in range(3))
    product = first * second * third
    return jnp.where(constants["between"] > 0, 4 * first * (1 - first), product)


def move(constants: Mapping[str, Any], u: Float[Values, "b m"]) -> Float[Values, "b 3 n"]:
    """Return the displacement that the fields give every vertex at controls u."""
    if "blocks" not in constants:
        return jnp.zeros((len(u), 3, len(constants["place"])), u.dtype)
    amount, blocks = coefficients(constants, u), constants["blocks"]
    moved = [
        (amount[:, blocks[name]["used"]] @ blocks[name]["fields"]).reshape(len(u), 3, -1) for name in sorted(blocks)
    ]
    return spread(jnp.concatenate(moved, axis=2), constants["place"])


# Soft limits on controls, so that Eq. 5's factor 3 gives a stronger face and not an explosion.

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
