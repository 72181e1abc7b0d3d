"""Display-only meshes that ride along: eyeballs turn with the gaze; brows, lashes, hair and horns sit on the skin."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int, UInt8
from scipy.spatial import cKDTree

from data_recipes.deformers import face, head_shape
from data_recipes.deformers.pose_curves import saturate

NEAREST = 4
SCALP_MM = 26.0  # hair below this height, on a head of adult size, moves with the scalp at this height
ADULT_HALF_WIDTH_MM = 75.0
GAZE_RAD = (np.deg2rad(26.0), np.deg2rad(20.0))  # a full look aside, up


@dataclass(frozen=True)
class RestProp:
    """A prop at rest.

    follow: "eye_left" or "eye_right"; any other prop follows the skin
    colours: an RGB from 0 to 255 for each vertex
    index, weight: the skin vertices that each vertex follows, and by how much
    """

    name: str
    follow: str
    colours: UInt8[np.ndarray, "k 3"]
    vertices: Float[np.ndarray, "k 3"]
    faces: Int[np.ndarray, "f 3"]
    index: Int[np.ndarray, "k 4"]
    weight: Float[np.ndarray, "k 4"]


def rest_props(head: Any) -> tuple[RestProp, ...]:
    """Return a head's props, each vertex tied to the nearest vertices of the outer skin."""
    outer = np.flatnonzero(
        np.isin(head.part, [i for i, n in enumerate(head.part_names) if n in ("face", "cranium", "neck")])
    )
    tree = cKDTree(head.vertices[outer])
    scalp = SCALP_MM * head.recipe.skull.cranium_radii[0] / ADULT_HALF_WIDTH_MM
    rest = []
    for prop in head.props:
        vertices = np.asarray(prop.vertices, np.float32)
        anchors = np.maximum(vertices, (-np.inf, scalp, -np.inf)) if prop.follow == "hair" else vertices
        distance, index = tree.query(anchors, k=NEAREST)
        weight = 1 / (distance + 0.5) ** 2
        rest.append(
            RestProp(
                name=prop.name,
                follow=prop.follow,
                colours=np.rint(255 * prop.colours).astype(np.uint8),
                vertices=vertices,
                faces=np.asarray(prop.faces, np.int32),
                index=outer[index].astype(np.int32),
                weight=(weight / weight.sum(axis=1, keepdims=True)).astype(np.float32),
            )
        )
    return tuple(rest)


def pose(
    props: tuple[RestProp, ...],
    constants: Any,
    columns: dict[str, int],
    params: Float[np.ndarray, "1 m"],
    vertices: Float[np.ndarray, "n 3"],
    neutral: Float[np.ndarray, "n 3"],
) -> list[tuple[str, np.ndarray, np.ndarray, np.ndarray]]:
    """Return name, vertices (k, 3) in mm, faces and colours (k, 3) of each prop in a pose.

    props: at rest
    constants: of the face's layers
    columns: of the controls, by name
    params: p
    vertices, neutral: the mesh in this pose and at rest, mm
    """
    u = np.asarray(saturate(constants["limits"], jnp.asarray(params)))
    values = face.shape_values(constants, jnp.asarray(u))
    rest = [neutral]
    for prop in props:
        x = prop.vertices
        if prop.follow.startswith("eye"):
            side = prop.follow.removeprefix("eye_")
            aside, up = (
                u[0, columns[name]] if name in columns else 0.0 for name in (f"look_x_{side}", f"look_y_{side}")
            )
            centre = np.asarray(constants[f"lids_{side}"]["centre"])
            x = (x - centre) @ gaze_rotation(aside * GAZE_RAD[0], up * GAZE_RAD[1]) + centre
        rest.append(x)
    # Skin and props bend, squash and stretch with the whole head, in one call.
    planes = jnp.asarray(np.concatenate(rest).T[None], jnp.float32)
    warped = np.asarray(_compile_warp()(constants["shape"], values, planes))[0].T
    skin, *warped = np.split(warped, np.cumsum([len(x) for x in rest])[:-1])
    displacement = vertices - skin  # what moves the skin besides that warp
    meshes = []
    for prop, x in zip(props, warped, strict=True):
        if not prop.follow.startswith("eye"):
            x = x + (displacement[prop.index] * prop.weight[..., None]).sum(axis=1)
        meshes.append((prop.name, x.astype(np.float32), prop.faces, prop.colours))
    return meshes


@cache
def _compile_warp() -> Callable:
    """Return the head's map of space, compiled once: uncompiled, its loop would be compiled at every call."""
    return jax.jit(head_shape.warp)


def gaze_rotation(aside: float, up: float) -> np.ndarray:
    """Return the matrix for row vectors that turns z up and then towards +x."""
    c, s = np.cos(up), np.sin(up)
    pitch = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    c, s = np.cos(aside), np.sin(aside)
    return pitch @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
