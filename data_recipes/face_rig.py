"""Our own rigs: a head, its controls and the face's deformers put together; their nodes and their props."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Float32, UInt8

from data_recipes.controls import limit_controls, make_controls
from data_recipes.deformers import face, posed_props, wrinkles
from data_recipes.ict import chain as ict_chain
from data_recipes.ict import facekit_eyeballs
from data_recipes.rig import Clip, Rig, check_rig
from replicate.engine.exceptions import InputError
from replicate.geometry.mesh import Mesh


@dataclass(frozen=True)
class FaceParts:
    """What makes a rig one of ours: the deformers' constants, the props at rest, the paint; and which deformers.

    The leaves are arrays. chain: a key of `CHAINS`.
    """

    constants: Any
    props: tuple[posed_props.RestProp, ...]
    paint: UInt8[np.ndarray, "n 3"]
    chain: str = "face"

    @cached_property
    def held(self) -> Any:
        """The constants where JAX computes: handed over as numpy arrays they would be copied at every call."""
        return jax.tree.map(jnp.asarray, self.constants)


# By chain: the module of its nodes, and the function that poses its props.
CHAINS = {"face": (face, posed_props.pose), "ict": (ict_chain, facekit_eyeballs.pose)}


@cache
def _evaluate(chain: str) -> Callable:
    return jax.jit(CHAINS[chain][0].evaluate)


def face_function(parts: FaceParts) -> Callable:
    """Return r(p), (b, m) → (b, n, 3), compiled per batch size; its constants are arguments, so it compiles fast."""
    evaluate = _evaluate(parts.chain)
    return lambda params: evaluate(parts.held, jnp.asarray(params, jnp.float32))


def build(name_or_recipe: str | Path) -> Rig:
    """Build a character from its recipe: head, controls, deformers, clips.

    Raises InputError, naming the recipe or the clip, for anything in the recipe that cannot be.
    """
    from data_recipes.acting.clip_file import read_clip
    from data_recipes.acting.procedural_acting import act
    from data_recipes.deformers.face_build import build_constants
    from data_recipes.deformers.face_points import control_points
    from data_recipes.deformers.sculpting import Sculptor
    from data_recipes.head.neutral_head import build_head
    from data_recipes.recipe.reading import load_recipe

    recipe = load_recipe(name_or_recipe)
    controls = make_controls(asdict(recipe.controls), recipe.file)
    controls = limit_controls(controls, recipe.limits.reach, recipe.limits.full, recipe.file)
    clips = [Clip(Path(file).stem, read_clip(Path(file), controls)) for file in recipe.clip_files]
    clips = [Clip(name, values) for name, values in act(controls, recipe.acting)] + clips
    with _naming(recipe.file):
        head = build_head(recipe)
        mesh = Mesh(
            neutral=head.vertices.astype(np.float32),
            faces=head.faces.astype(np.int32),
            uv=np.clip(head.uv, 0, 1).astype(np.float32),
            segment=head.segment.astype(np.int32),
            segment_names=head.segment_names,
        )
        points, regions = control_points(Sculptor(head))
        parts = FaceParts(build_constants(head, controls), posed_props.rest_props(head), head.paint)
    rig = Rig(
        name=recipe.name,
        mesh=mesh,
        controls=controls,
        landmarks=np.array(list(head.landmarks.values()), np.int32),
        landmark_names=tuple(head.landmarks),
        control_points=points,
        control_point_regions=regions,
        clips=tuple(clips) or None,
        function=face_function(parts),
        face=parts,
    )
    return check_rig(rig)


@contextmanager
def _naming(file: str) -> Iterator[None]:
    """Put the recipe's file in front of an InputError that doesn't begin with it."""
    try:
        yield
    except InputError as error:
        if str(error).startswith(f"{file}: "):
            raise
        raise InputError(f"{file}: {error}") from error


@cache
def _compiled(node: face.Node) -> Callable:
    return jax.jit(node.function)


@cache
def _switched_off(node: face.Node) -> face.Node:
    return face.switched_off(node)


def node_steps(
    rig: Rig, params: Float[np.ndarray, "b m"], skip: Collection[str] = (), upto: str | None = None
) -> Iterator[tuple[str, face.State]]:
    """Run each node for itself, its result handed on in memory, and yield its name and the state after it.

    skip: names of nodes to switch off; upto: the last node to run. Raises InputError for a rig or a name without nodes.
    """
    nodes = _chosen(rig, skip, upto)
    constants = rig.face.held
    state = face.start(constants, jnp.asarray(params, jnp.float32))
    for node in nodes:
        # Of the constants each node gets its own alone: to hand over all would take longer than some nodes do.
        own = {name: constants[name] for name in node.reads}
        state = jax.block_until_ready(_compiled(node)(own, state))
        yield node.name, state


def _chosen(rig: Rig, skip: Collection[str], upto: str | None) -> list[face.Node]:
    if rig.face is None:
        raise InputError(f"rig '{rig.name}': it has no nodes, where only rigs built from recipes can be run by them.")
    chain = CHAINS[rig.face.chain][0].NODES
    names = [node.name for node in chain]
    skip = (skip,) if isinstance(skip, str) else tuple(skip)
    unknown = [name for name in (*skip, *([upto] if upto is not None else [])) if name not in names]
    if unknown:
        raise InputError(f"rig '{rig.name}': it has no node '{unknown[0]}'; allowed are {', '.join(names)}.")
    last = len(names) if upto is None else names.index(upto) + 1
    return [_switched_off(node) if node.name in skip else node for node in chain[:last]]


def run_nodes(
    rig: Rig, params: Float[np.ndarray, "b m"], skip: Collection[str] = (), upto: str | None = None
) -> Float32[np.ndarray, "b n 3"]:
    """Return r(p), or what the chosen nodes make of p, by running each node for itself; see `node_steps`."""
    *_, (_, state) = node_steps(rig, params, skip, upto)
    return np.asarray(face.finish(state))


def wrinkle_states(rig: Rig, params: Float[np.ndarray, " m"]) -> dict[str, wrinkles.RegionState]:
    """Return what each wrinkle region does in a pose, by name."""
    names = [node.name for node in CHAINS[rig.face.chain][0].NODES]
    before = names[names.index("wrinkles") - 1]
    *_, (_, state) = node_steps(rig, np.asarray(params, np.float32)[None], upto=before)
    return wrinkles.region_states(rig.face.held["wrinkles"], state["x"], state["u"])


def pose_props(rig: Rig, params: Float[np.ndarray, " m"]) -> list[tuple[str, np.ndarray, np.ndarray, np.ndarray]]:
    """Return each prop's name, vertices, faces and colours in a pose."""
    p = np.asarray(params, np.float32).reshape(1, -1)
    vertices = np.asarray(rig.function(p))[0]
    columns = {control.name: i for i, control in enumerate(rig.controls)}
    return CHAINS[rig.face.chain][1](rig.face.props, rig.face.constants, columns, p, vertices, rig.mesh.neutral)
