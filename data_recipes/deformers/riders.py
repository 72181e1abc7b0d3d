"""Riders: shells that stand in the skin go where the skin around their roots goes (after layer 8).

The actions that move them are sculpted in layer 1, and the head's shape takes them along.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from data_recipes.deformers.node_chain import Constants, Values, place_of, spread

NEAREST = 12  # skin vertices around a root


def prepare(
    neutral: Float[np.ndarray, "n 3"], shells: list[Int[np.ndarray, "rows k"]], skin: Int[np.ndarray, " s"]
) -> dict[str, np.ndarray]:
    """Return the constants for shells given as rings from the root outwards, and the skin's vertices."""
    around = np.zeros((len(shells), NEAREST), np.int32)
    for i, shell in enumerate(shells):
        root = neutral[shell[: max(len(shell) // 3, 1)].ravel()].mean(axis=0)
        around[i] = skin[np.argsort(np.linalg.norm(neutral[skin] - root, axis=1), kind="stable")[:NEAREST]]
    support = np.concatenate([shell.ravel() for shell in shells]) if shells else np.zeros(0, int)
    return {
        "around": around,
        "rest": neutral[around].mean(axis=1).T.astype(np.float32),
        "owner": np.repeat(np.arange(len(shells)), [shell.size for shell in shells]).astype(np.int32),
        "place": place_of(support, len(neutral)),
    }


def ride(constants: Constants, x: Float[Values, "b 3 n"]) -> Float[Array, "b 3 n"] | Float[Values, "b 3 n"]:
    """Return positions in which every shell has gone with the skin around its root."""
    if len(constants["around"]) == 0:
        return x
    displacement = x[:, :, constants["around"]].mean(axis=-1) - constants["rest"]  # (b, 3, shells)
    return x + spread(jnp.asarray(displacement)[:, :, constants["owner"]], constants["place"])
