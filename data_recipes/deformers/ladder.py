"""A face on one step of the ladder (see `face_chain`): its chain, and the constants that this chain needs."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from data_recipes.controls import Control, control_index
from data_recipes.deformers import node_chain
from data_recipes.deformers.face_build import build_constants
from data_recipes.deformers.face_chain import LADDER, ROTATIONS, SHORT_WAVES, TARGETS
from data_recipes.deformers.node_chain import Chain
from data_recipes.deformers.shape_targets import prepare_rivets, sample_targets
from data_recipes.head.neutral_head import Head

BATCH = 32


def build_step(head: Head, controls: tuple[Control, ...], step: int) -> tuple[Chain, dict[str, Any]]:
    """Return the chain of a step, 1 to 6, and its constants."""
    chain, wave = LADDER[step], 0.5 if step == SHORT_WAVES else 1.0
    constants = build_constants(head, controls, wave)
    if chain is TARGETS:
        constants |= _target_constants(head, controls, constants, curved=step > 1)
    return chain, constants


def _target_constants(head: Head, controls: tuple[Control, ...], constants: dict, curved: bool) -> dict[str, Any]:
    """Return the targets of steps 1 and 2, taken from step 3 without its limits, and the teeth's rivets."""
    chain = Chain(ROTATIONS.name, ROTATIONS.nodes[1:], ROTATIONS.pose_props)
    arrays, neutral = jax.tree.map(jnp.asarray, constants), head.vertices.astype(np.float32)
    evaluate = jax.jit(lambda u: node_chain.evaluate(chain, arrays, u + arrays["limits"]["default"]))

    def offsets(u: np.ndarray) -> np.ndarray:
        padded = np.concatenate([u, np.zeros((-len(u) % BATCH, u.shape[1]), np.float32)])
        parts = [np.asarray(evaluate(padded[i : i + BATCH])) - neutral for i in range(0, len(padded), BATCH)]
        return np.concatenate(parts)[: len(u)]

    one_sided = np.array([control.lower >= control.default for control in controls])
    columns = control_index(controls)
    return {
        "targets": sample_targets(offsets, one_sided, columns, len(neutral), curved),
        "rivets": prepare_rivets(head.vertices, list(head.grids["teeth"]), constants["teeth"]["place"]),
    }
