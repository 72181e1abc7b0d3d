"""Our own rigs: a head, its controls and the face's deformers put together; their nodes and their props."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Float32, UInt8

from data_recipes.controls import make_controls
from data_recipes.deformers import face, props
from data_recipes.rig import Clip, Rig, check_rig
from replicate.errors import InputError
from replicate.mesh import Mesh


@dataclass(frozen=True)
class FaceParts:
    """What makes a rig one of ours: the deformers' constants, the props at rest and the paint; leaves are arrays."""

    constants: Any
    props: tuple[props.RestProp, ...]
    paint: UInt8[np.ndarray, "n 3"]


@cache
def _evaluate() -> Callable:
    return jax.jit(face.evaluate)


def face_function(constants: Any) -> Callable:
    """Return r(p), (b, m) → (b, n, 3), compiled per batch size; its constants are arguments, so it compiles fast."""
    held = jax.tree.map(jnp.asarray, constants)
    evaluate = _evaluate()
    return lambda params: evaluate(held, jnp.asarray(params, jnp.float32))


def build(name_or_recipe: str | Path) -> Rig:
    """Build a character from its recipe: head, controls, deformers, clips.

    Raises InputError, naming the recipe or the clip, for anything in the recipe that cannot be.
    """
    from data_recipes.animation import act
    from data_recipes.clip_file import read_clip
    from data_recipes.deformers.face_build import build_constants
    from data_recipes.deformers.face_points import control_points
    from data_recipes.deformers.sculpting import Sculptor
    from data_recipes.head import build_head
    from data_recipes.recipe import load_recipe

    recipe = load_recipe(name_or_recipe)
    controls = make_controls(asdict(recipe.controls), recipe.file)
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
        constants = build_constants(head, controls)
    rig = Rig(
        name=recipe.name,
        mesh=mesh,
        controls=controls,
        landmarks=np.array(list(head.landmarks.values()), np.int32),
        landmark_names=tuple(head.landmarks),
        control_points=points,
        control_point_regions=regions,
        clips=tuple(clips) or None,
        function=face_function(constants),
        face=FaceParts(constants, props.rest_props(head), head.paint),
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
def _compiled_nodes() -> tuple[tuple[str, Callable], ...]:
    return tuple((node.name, jax.jit(node.function)) for node in face.NODES)


def run_nodes(rig: Rig, params: Float[np.ndarray, "b m"]) -> Float32[np.ndarray, "b n 3"]:
    """Return r(p) by running each node for itself, its result handed on in memory."""
    state = face.start(jnp.asarray(params, jnp.float32))
    for _, function in _compiled_nodes():
        state = jax.block_until_ready(function(rig.face.constants, state))
    return np.asarray(face.finish(state))


def pose_props(rig: Rig, params: Float[np.ndarray, " m"]) -> list[tuple[str, np.ndarray, np.ndarray, np.ndarray]]:
    """Return each prop's name, vertices, faces and colours in a pose."""
    p = np.asarray(params, np.float32).reshape(1, -1)
    vertices = np.asarray(rig.function(p))[0]
    columns = {control.name: i for i, control in enumerate(rig.controls)}
    return props.pose(rig.face.props, rig.face.constants, columns, p, vertices, rig.mesh.neutral)
