"""A face of summed expressions with a real jaw: limits, shapes, a bound on their sum, the jaw, wrinkles.

The layers are those of `deformers.face` where they have one (jaw, wrinkles); the nodes keep its contract: each takes
the constants and a batch's state ("p", "u" (b, m), positions "x" as planes (b, 3, n)) and returns the state after it.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from data_recipes.deformers import jaw, wrinkles
from data_recipes.deformers.jaw import JawMotion
from data_recipes.deformers.node_chain import FaceConstants, Node, State
from data_recipes.deformers.planes import Values, spread
from data_recipes.deformers.saturation import SHARPNESS, saturate


def effective(constants: FaceConstants, params: Float[Values, "b m"]) -> Float[Array, "b m"]:
    """Return the controls' effective values: bent towards their limits, and some scaled by others.

    A shut eye leaves nothing for looks and squints to do with its lids (`blink`, (m, m): who shuts whose); lips close
    over an open jaw alone (`gate`, (m, m): who is opened by whom, and `free`, (m,): 1 for all others).
    """
    controls = constants["controls"]
    u = saturate(constants["limits"], params * controls["stretch"])
    u = u * (1 - jnp.clip(u @ controls["blink"], 0.0, 1.0))
    return u * (controls["free"] + u @ controls["gate"])


def limit(constants: FaceConstants, state: State) -> State:
    """Bend the parameters towards their limits."""
    return state | {"u": effective(constants, state["p"])}


def add_shapes(constants: FaceConstants, state: State) -> State:
    """Sum the expressions, and bend each vertex's sum towards a little more than any one of them moves it."""
    shapes, u = constants["shapes"], state["u"]
    offset = (u @ shapes["fields"]).reshape(len(u), 3, -1)
    ratio = (offset * offset).sum(axis=1, keepdims=True) * shapes["inverse_square"]
    offset = offset * (1 + ratio ** (SHARPNESS // 2)) ** (-1 / SHARPNESS)
    return state | {"x": constants["neutral"] + spread(offset, shapes["place"])}


def open_the_jaw(constants: FaceConstants, state: State) -> State:
    """Turn and slide the jaw."""
    motion = JawMotion(state["u"] @ constants["jaw_turn"], state["u"] @ constants["jaw_slide"])
    return state | {"x": jaw.open_jaw(constants["jaw"], state["x"], motion)}


def close_lips(constants: FaceConstants, state: State) -> State:
    """Close the lips over the open jaw, in the skull's frame."""
    shapes, u = constants["closing"], state["u"]
    offset = (u @ shapes["fields"]).reshape(len(u), 3, -1)
    return state | {"x": state["x"] + spread(offset, shapes["place"])}


def fold_skin(constants: FaceConstants, state: State) -> State:
    """Fold the skin where it is compressed."""
    return state | {"x": wrinkles.wrinkle(constants["wrinkles"], state["x"], state["u"])}


NODES = (
    Node("limit", limit, ("limits", "controls")),
    Node("shapes", add_shapes, ("neutral", "shapes")),
    Node("jaw", open_the_jaw, ("jaw", "jaw_turn", "jaw_slide")),
    Node("lip_closing", close_lips, ("closing",)),
    Node("wrinkles", fold_skin, ("wrinkles",)),
)
