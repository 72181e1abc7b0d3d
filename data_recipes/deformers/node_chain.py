"""A face as a chain of nodes: what a node is, and how a chain runs, whole or with some of its nodes switched off.

Each node takes the constants and the state of a batch and returns the state after it. The state holds the parameters
"p" (b, m), the soft-limited controls "u" (b, m), the positions "x" as planes (b, 3, n), and results that later nodes
need of earlier ones. Composed, the nodes are the rig's function.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from data_recipes.deformers.planes import Values

FaceConstants = Mapping[str, Any]  # a deformer's constants by layer; leaves are arrays
State = dict[str, Any]


@dataclass(frozen=True)
class Node:
    """One step of the rig: a name, a function of the constants and the state, and which of the constants it reads."""

    name: str
    function: Callable[[FaceConstants, State], State]
    reads: tuple[str, ...]


@dataclass(frozen=True)
class Chain:
    """A face's nodes in order, by a name that files know it by, and the function that poses its props.

    pose_props: props at rest, constants, columns of the controls by name, p (1, m), posed vertices (n, 3), neutral
    (n, 3) → for each prop its name, vertices (k, 3), faces and colours (k, 3).
    """

    name: str
    nodes: tuple[Node, ...]
    pose_props: Callable[..., list]


def start(constants: FaceConstants, params: Float[Values, "b m"]) -> State:
    """Return the state before the first node: the neutral face, and controls without limits."""
    neutral = jnp.broadcast_to(constants["neutral"], (len(params), *constants["neutral"].shape[-2:]))
    return {"p": params, "u": params - constants["limits"]["default"], "x": neutral}


def switch_off(node: Node) -> Node:
    """Return a node that leaves positions and controls as they were, and hands on what the node does at rest.

    So without the jaw's node the lower teeth stay closed too, since they ask it how far the jaw has turned.
    """

    def function(constants: FaceConstants, state: State) -> State:
        still = node.function(constants, state | {"u": jnp.zeros_like(state["u"])})
        return still | {name: state[name] for name in ("p", "u", "x")}

    return Node(node.name, function, node.reads)


def finish(state: State) -> Float[Array, "b n 3"]:
    """Return the vertices (mm) from the state after the last node."""
    return state["x"].transpose(0, 2, 1)


def evaluate(chain: Chain, constants: FaceConstants, params: Float[Values, "b m"]) -> Float[Array, "b n 3"]:
    """Return r(p) for a batch: every node in turn."""
    state = start(constants, params)
    for node in chain.nodes:
        state = node.function(constants, state)
    return finish(state)
