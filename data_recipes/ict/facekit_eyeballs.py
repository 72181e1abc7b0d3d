"""The eyeballs, for display only: they turn with the looks.

The model's eyes are shells for transparent textures, as are its lashes, tear fluid and shadow strips: ours stand in.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from data_recipes.deformers.posed_props import NEAREST, RestProp, gaze_rotation
from data_recipes.head.eyeballs import eyeball
from data_recipes.ict.facekit_files import FaceKit
from data_recipes.ict.facekit_nodes import effective
from data_recipes.recipe.facekit import Parts
from data_recipes.recipe.reading import Recipe
from data_recipes.recipe.sections import Eyes

EYE = {"iris_deg": 27.0, "pupil_deg": 11.0, "iris_colour": (0.33, 0.42, 0.50)}
LOOK_DEG = {"out": 32.0, "in": 32.0, "up": 24.0, "down": 30.0}  # at 1; the model's shapes move the lids alone
LETTER = {"left": "L", "right": "R"}


def rest_props(model: FaceKit, parts: Parts) -> tuple[RestProp, ...]:
    """Return the eyeballs at rest: ours, in the middle and of the size of the model's."""
    rest = []
    for side, mirror in (("left", 1.0), ("right", -1.0)):
        first, last = getattr(parts, f"eyeball_{side}")
        x = model.vertices[first : last + 1]
        centre = sphere_centre(x)
        radius = float(np.median(np.linalg.norm(x - centre, axis=1)))
        eyes = Eyes(centre=tuple((centre * (mirror, 1, 1)).tolist()), radius=radius, **EYE)
        for part in eyeball(Recipe(name=side, vertices=1, eyes=eyes)):
            faces = part.faces if mirror > 0 else part.faces[:, ::-1]
            vertices = np.asarray(part.vertices, np.float32) * np.float32((mirror, 1, 1))
            loose = np.zeros((len(vertices), NEAREST))
            rest.append(
                RestProp(
                    name=part.name.replace("left", side),
                    follow=f"eye_{side}",
                    colours=np.rint(255 * np.clip(part.colours, 0, 1)).astype(np.uint8),
                    vertices=vertices,
                    faces=np.ascontiguousarray(faces, np.int32),
                    index=loose.astype(np.int32),
                    weight=loose.astype(np.float32),
                )
            )
    return tuple(rest)


def sphere_centre(x: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, " 3"]:
    """Return the centre of the sphere that fits points best."""
    x = np.asarray(x, np.float64)
    system = np.concatenate([2 * x, np.ones((len(x), 1))], axis=1)
    return np.linalg.lstsq(system, (x * x).sum(axis=1), rcond=None)[0][:3]


def pose(
    props: tuple[RestProp, ...],
    constants: Mapping[str, Any],
    columns: dict[str, int],
    params: Float[np.ndarray, "1 m"],
    vertices: Float[np.ndarray, "n 3"],
    neutral: Float[np.ndarray, "n 3"],
) -> list[tuple[str, np.ndarray, np.ndarray, np.ndarray]]:
    """Return name, vertices (k, 3), faces and colours (k, 3) of each prop where the posed skin `vertices` take it."""
    u = np.asarray(effective(constants, jnp.asarray(params)))[0]
    whole = {prop.follow: [p.vertices for p in props if p.follow == prop.follow] for prop in props}
    centres = {follow: sphere_centre(np.concatenate(vertices)) for follow, vertices in whole.items()}
    meshes = []
    for prop in props:
        centre = centres[prop.follow]
        x = (prop.vertices - centre) @ gaze_rotation(*_look(u, columns, prop.follow.removeprefix("eye_"))) + centre
        meshes.append((prop.name, x.astype(np.float32), prop.faces, prop.colours))
    return meshes


def _look(u: np.ndarray, columns: dict[str, int], side: str) -> tuple[float, float]:
    """Return how far an eye looks towards +x and up, in radians."""
    amount = {}
    for way, degrees in LOOK_DEG.items():
        column = columns.get(f"eyeLook{way.capitalize()}_{LETTER[side]}")
        amount[way] = 0.0 if column is None else np.deg2rad(degrees) * u[column]
    outwards = amount["out"] - amount["in"]
    return outwards if side == "left" else -outwards, amount["up"] - amount["down"]
