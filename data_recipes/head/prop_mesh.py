"""Meshes of props, with a colour for each vertex, and how to lay one on the head."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from data_recipes.head.shape import FLIP, distance_and_gradient, raycast
from data_recipes.head.topology import grid_quads


@dataclass(frozen=True)
class Prop:
    """A mesh at rest, in mm.

    follow: "eye_left" or "eye_right" to turn with the gaze, "skin" to move with the skin under it, "hair" to move with
        the scalp where it hangs lower than the ears
    colours: an RGB in [0, 1] for each vertex
    """

    name: str
    follow: str
    colours: Float[np.ndarray, "k 3"]
    vertices: Float[np.ndarray, "k 3"]
    faces: Int[np.ndarray, "f 3"]


def sheet(
    name: str,
    follow: str,
    colours: tuple[float, float, float] | Float[np.ndarray, "rows columns 3"],
    grid: Float[np.ndarray, "rows columns 3"],
) -> Prop:
    """Make a prop of a grid whose rows run up and whose columns run to the right, seen from outside.

    colours: one RGB, or one for each point of the grid.
    """
    quads = grid_quads(np.arange(grid.shape[0] * grid.shape[1]).reshape(grid.shape[:2]))
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)
    p = grid.reshape(-1, 3)
    area = np.linalg.norm(np.cross(p[faces[:, 1]] - p[faces[:, 0]], p[faces[:, 2]] - p[faces[:, 0]]), axis=1)
    rgb = np.broadcast_to(np.asarray(colours, float), grid.shape).reshape(-1, 3)
    return Prop(name, follow, np.clip(rgb, 0, 1), p, faces[area > 1e-9])


def join(name: str, follow: str, parts: Sequence[Prop]) -> Prop:
    """Make one prop of several."""
    first = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    return Prop(
        name,
        follow,
        np.concatenate([part.colours for part in parts]),
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + np.int32(k) for part, k in zip(parts, first, strict=True)]),
    )


def mirror_prop(prop: Prop) -> Prop:
    """Return a left-hand prop's image on the right."""
    name, follow = prop.name.replace("left", "right"), prop.follow.replace("left", "right")
    return Prop(name, follow, prop.colours, prop.vertices * FLIP, prop.faces[:, ::-1].copy())


def on_skin(
    sdf: Callable, origins: Float[np.ndarray, "k 3"], directions: Float[np.ndarray, "k 3"]
) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3"]]:
    """Return where rays meet a surface, and its unit normals there."""
    p = raycast(sdf, origins, directions)
    _, normal = distance_and_gradient(sdf, p, 0.5)
    return p, normal / np.linalg.norm(normal, axis=1, keepdims=True)
