"""A face as a chain of nodes: what a node is, and how a chain runs, whole or with some of its nodes switched off.

Each node takes the constants and the state of a batch, and returns the state after it. The state holds the parameters
"p" (b, m), the soft-limited controls "u" (b, m), the positions "x" as planes (b, 3, n), and results that later nodes
need. All nodes in turn are the rig's function.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

# Between positions as planes (b, 3, n) and a deformer's support, the s vertices that it reads or moves.

# Arrays are numpy's when fresh or loaded, and JAX's inside a compiled function. `Constants` are those of one deformer.
Values = Array | np.ndarray
Constants = Mapping[str, Values]


def place_of(support: Int[np.ndarray, " s"], n: int) -> Int[np.ndarray, " n"]:
    """Return, for each of n vertices, its position in `support`, or s (one past the end) outside it."""
    place = np.full(n, len(support), np.int32)
    place[support] = np.arange(len(support))
    return place


def selection(columns: Int[np.ndarray, " k"], m: int) -> Float[np.ndarray, "m k"]:
    """Return the matrix that picks columns of p in a product; a column ≥ m, for a control that the rig lacks, gives 0.

    A product is computed once. A gather would be fused into what uses it and repeated for every vertex.
    """
    return (np.arange(m)[:, None] == np.asarray(columns)[None]).astype(np.float32)


def pick(rows: Float[Values, "*s"], index: Int[Values, " k"]) -> Float[Array, "*k"]:
    """Return some rows. Indices are not checked, since that would double the operations to compile."""
    return jnp.asarray(rows).at[index].get(mode="promise_in_bounds", wrap_negative_indices=False)


def rows_at(x: Float[Values, "b 3 n"], support: Int[Values, " s"]) -> Float[Array, "s 3 b"]:
    """Return some vertices' positions as rows, with the poses side by side: rows are ten times as fast to gather.

    The loop over x, y and z keeps the compiler from fusing this with what comes before, which it would then compute row
    by row, across the planes.
    """
    planes, support = jnp.asarray(x), jnp.asarray(support)

    def turn(k, rows):
        plane = jax.lax.dynamic_index_in_dim(planes, k, axis=1, keepdims=False).T
        return jax.lax.dynamic_update_slice(rows, pick(plane, support)[:, None], (0, k, 0))

    return jax.lax.fori_loop(0, 3, turn, jnp.zeros((len(support), 3, len(planes)), planes.dtype))


def add_rows(x: Float[Values, "b 3 n"], rows: Float[Array, "s 3 b"], place: Int[Values, " n"]) -> Float[Array, "b 3 n"]:
    """Return positions with the support's rows added; place: from `place_of`. `rows_at` says why there are loops."""
    planes, place = jnp.asarray(x), jnp.asarray(place)

    def turn(k, turned):
        plane = jax.lax.dynamic_index_in_dim(rows, k, axis=1, keepdims=False).T[:, None]
        return jax.lax.dynamic_update_slice(turned, plane, (0, k, 0))

    def add(k, total):
        plane = jax.lax.dynamic_index_in_dim(total, k, axis=1)
        moved = spread(jax.lax.dynamic_index_in_dim(turned, k, axis=1), place)
        return jax.lax.dynamic_update_slice(total, plane + moved, (0, k, 0))

    turned = jax.lax.fori_loop(0, 3, turn, jnp.zeros(rows.shape[::-1], rows.dtype))
    return jax.lax.fori_loop(0, 3, add, planes)


def spread(values: Float[Values, "*b s"], place: Int[Values, " n"]) -> Float[Values, "*b n"]:
    """Return values on all n vertices: those of the support at their vertices, 0 elsewhere.

    place: from `place_of`. This is a gather; scattering on a CPU takes several times as long.
    """
    padded = jnp.concatenate([values, jnp.zeros_like(values[..., :1])], axis=-1)
    return padded[..., place]


def sine_cosine(angle: Float[Values, "*s"]) -> tuple[Array, Array]:
    """Return sin and cos of angles up to about 1 radian as power series (error below 3e-8), which vectorise."""
    q = angle * angle
    sine = angle * (1 - q / 6 * (1 - q / 20 * (1 - q / 42 * (1 - q / 72 * (1 - q / 110)))))
    cosine = 1 - q / 2 * (1 - q / 12 * (1 - q / 30 * (1 - q / 56 * (1 - q / 90 * (1 - q / 132)))))
    return sine, cosine


def cross(a: Float[Values, "*b 3 s"], b: Float[Values, "*b 3 s"]) -> Float[Values, "*b 3 s"]:
    """Return the cross products of two fields of vectors."""
    ax, ay, az = a[..., 0, :], a[..., 1, :], a[..., 2, :]
    bx, by, bz = b[..., 0, :], b[..., 1, :], b[..., 2, :]
    return jnp.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-2)


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
    """A face's nodes in order, its name in saved rigs, and the function that poses its props.

    pose_props: props at rest, constants, columns of the controls by name, p (1, m), posed vertices (n, 3), neutral
    (n, 3) → for each prop its name, vertices (k, 3), faces and colours (k, 3)
    hard_limits: whether poses beyond the controls' limits mean nothing; our faces bend towards theirs
    """

    name: str
    nodes: tuple[Node, ...]
    pose_props: Callable[..., list]
    hard_limits: bool = False


def start(constants: FaceConstants, params: Float[Values, "b m"]) -> State:
    """Return the state before the first node: the neutral face, and controls without limits."""
    neutral = jnp.broadcast_to(constants["neutral"], (len(params), *constants["neutral"].shape[-2:]))
    return {"p": params, "u": params - constants["limits"]["default"], "x": neutral}


def switch_off(node: Node) -> Node:
    """Return a node that leaves positions and controls as they were, and gives later nodes its results at rest.

    So with the jaw switched off the lower teeth stay closed too, since they follow the jaw's motion in the state.
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
