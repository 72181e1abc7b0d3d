"""Pose interpolation on curves: sculpted fields, in-betweens, combination correctives (layer 1).

A face action moves each vertex along a parabola through the neutral (u = 0), the half pose and the full pose:
X += u·D₁ + 4u(1 − u)·D₂. A corrective adds its field times the product of two or three controls. Since all of it is
linear in the coefficients, one matrix product moves the whole batch.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from data_recipes.deformers.planes import Constants, Values, place_of, spread


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
        """Add a field, unless it nowhere exceeds a micrometre."""
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

        factor (k, 3): columns of [p, 1] whose product drives field k; between (k,): 1 where 4u(1 − u) does;
        fields (k, 3 s): displacements of the support's vertices; place (n,): see planes.place_of.
        """
        if not self.vectors:
            return {
                "factor": np.zeros((0, 3), np.int32),
                "between": np.zeros(0, np.float32),
                "fields": np.zeros((0, 3), np.float32),
                "place": np.ones(self.n, np.int32),
            }
        stacked = np.stack(self.vectors)
        support = np.flatnonzero(np.abs(stacked).max(axis=(0, 2)) > 1e-4)
        factor = np.array([list(d) + [columns] * (3 - len(d)) for d in self.drivers], np.int32)
        return {
            "factor": factor,
            "between": np.asarray(self.between, np.float32),
            "fields": np.ascontiguousarray(stacked[:, support].transpose(0, 2, 1)).reshape(len(stacked), -1),
            "place": place_of(support, self.n),
        }


def coefficients(constants: Constants, u: Float[Values, "b m"]) -> Float[Values, "b k"]:
    """Return each field's coefficient: u, 4u(1 − u), or a product of controls."""
    padded = jnp.concatenate([u, jnp.ones_like(u[:, :1])], axis=1)
    first, second, third = (padded[:, constants["factor"][:, i]] for i in range(3))
    product = first * second * third
    return jnp.where(constants["between"] > 0, 4 * first * (1 - first), product)


def move(constants: Constants, u: Float[Values, "b m"]) -> Float[Values, "b 3 n"]:
    """Return the displacement that the fields give every vertex at controls u."""
    flat = coefficients(constants, u) @ constants["fields"]
    return spread(flat.reshape(len(u), 3, -1), constants["place"])
