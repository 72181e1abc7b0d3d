"""Our rigs: faces with paint and props, whose functions are chains of nodes that can also be run one by one."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from functools import cache, cached_property, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

from data_recipes.deformers import node_chain, wrinkles
from data_recipes.deformers.node_chain import Chain, Node, State, Values
from data_recipes.deformers.posed_props import RestProp
from data_recipes.function_rig import FunctionRig
from data_recipes.rig import Prop
from replicate.base.exceptions import InputError


@dataclass(frozen=True)
class FaceParts:
    """What one of our rigs is made of.

    constants: those of each deformer, by layer; the leaves are arrays
    props: the display-only meshes at rest
    paint: a colour for each vertex
    rigid: names of segments that are rigid by construction
    chain: the deformers
    """

    constants: Any
    props: tuple[RestProp, ...]
    paint: UInt8[np.ndarray, "n 3"]
    chain: Chain
    rigid: tuple[str, ...] = ()

    @cached_property
    def on_device(self) -> Any:
        """The constants as JAX arrays: numpy arrays would be copied at every call."""
        # The first call may be within a trace (of a Jacobian, say), whose arrays are invalid after it.
        with jax.ensure_compile_time_eval():
            return jax.device_put(self.constants)


def face_function(parts: FaceParts) -> Callable:
    """Return r(p), (b, m) → (b, n, 3), compiled per batch size; it compiles fast since constants are arguments."""
    evaluate = _compile_chain(parts.chain)
    return lambda params: evaluate(parts.on_device, jnp.asarray(params, jnp.float32))


@cache
def _compile_chain(chain: Chain) -> Callable:
    return jax.jit(partial(node_chain.evaluate, chain))


@cache
def _compile_node(node: Node) -> Callable:
    return jax.jit(node.function)


@cache
def _switch_off(node: Node) -> Node:
    return node_chain.switch_off(node)


@dataclass(frozen=True)
class FaceRig(FunctionRig):
    """A character built from a recipe, or loaded again. face: what its function, nodes and props are made from."""

    function: Callable[[Any], Any] = field(init=False)
    face: FaceParts = field(kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "function", face_function(self.face))
        super().__post_init__()

    @property
    def nodes(self) -> tuple[Node, ...]:
        """The deformers in order, each a name and a `function(constants, state) → state`."""
        return self.face.chain.nodes

    @property
    def rigid_segments(self) -> tuple[str, ...]:
        """Names of segments that are rigid by construction."""
        return self.face.rigid

    @property
    def hard_limits(self) -> bool:
        """Whether poses beyond the controls' limits mean nothing."""
        return self.face.chain.hard_limits

    @property
    def paint(self) -> UInt8[np.ndarray, "n 3"]:
        """A colour for each vertex, for display only."""
        return self.face.paint

    @property
    def file_vertices(self) -> Int[np.ndarray, " v"]:
        """Where the vertices of the file that a face of shapes comes from are among the mesh's, −1 for none.

        Of a face from no such file it is empty.
        """
        return np.asarray(self.face.constants.get("file_vertices", {"place": np.zeros(0, np.int32)})["place"])

    def pose_props(self, params: Float[np.ndarray, " m"]) -> list[Prop]:
        """Return the display-only meshes (eyeballs, brows, …) in the pose (m,)."""
        p = np.asarray(params, np.float32).reshape(1, -1)
        vertices = np.asarray(self.function(p))[0]
        columns = {control.name: i for i, control in enumerate(self.controls)}
        return self.face.chain.pose_props(self.face.props, self.face.constants, columns, p, vertices, self.mesh.neutral)

    def node_steps(
        self, params: Float[Values, "b m"], skip: Collection[str] = (), upto: str | None = None
    ) -> Iterator[tuple[str, State]]:
        """Run node after node, and yield each one's name and the state after it.

        The state's "x" are the positions so far as planes (b, 3, n), its "u" the limited controls (b, m). skip: names
        of nodes to switch off. upto: the last node to run. Raises InputError for unknown names.
        """
        nodes = _select_nodes(self, skip, upto)
        constants = self.face.on_device
        state = node_chain.start(constants, jnp.asarray(params, jnp.float32))
        for node in nodes:
            # A node gets only the constants that it reads: to hand over all takes longer than some nodes do.
            needed = {name: constants[name] for name in node.reads}
            state = jax.block_until_ready(_compile_node(node)(needed, state))
            yield node.name, state

    def run_nodes(
        self, params: Float[Values, "b m"], skip: Collection[str] = (), upto: str | None = None
    ) -> Float32[np.ndarray, "b n 3"]:
        """Return r(p) of (b, m), or the result of some nodes: one after the other, as a production engine runs them.

        skip: names of nodes to switch off. upto: the last node to run. Raises InputError for unknown names.
        """
        *_, (_, state) = self.node_steps(params, skip, upto)
        return np.asarray(node_chain.finish(state))

    def wrinkle_states(self, params: Float[Values, " m"]) -> dict[str, wrinkles.RegionState]:
        """Return the state of each wrinkle region in the pose (m,), by name; of a rig without wrinkles, none."""
        names = [node.name for node in self.nodes]
        if "wrinkles" not in names:
            return {}
        before = names[names.index("wrinkles") - 1]
        *_, (_, state) = self.node_steps(np.asarray(params, np.float32)[None], upto=before)
        return wrinkles.region_states(self.face.on_device["wrinkles"], state["x"], state["u"])


def _select_nodes(rig: FaceRig, skip: Collection[str], upto: str | None) -> list[Node]:
    names = [node.name for node in rig.nodes]
    skip = (skip,) if isinstance(skip, str) else tuple(skip)
    unknown = [name for name in (*skip, *([upto] if upto is not None else [])) if name not in names]
    if unknown:
        raise InputError(f"rig '{rig.name}': there is no node '{unknown[0]}'; there are {', '.join(names)}")
    last = len(names) if upto is None else names.index(upto) + 1
    return [_switch_off(node) if node.name in skip else node for node in rig.nodes[:last]]
