"""A face of summed expressions with a real jaw: limits, shapes, a bound on their sum, the jaw, wrinkles.

Jaw and wrinkles are those of `deformers.face`. The nodes keep its contract too: each gets the constants and the state
of a batch ("p" and "u" (b, m), positions "x" as planes (b, 3, n)) and returns the state after it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from data_recipes.deformers import jaw, wrinkles
from data_recipes.deformers.jaw import JawMotion
from data_recipes.deformers.node_chain import Chain, FaceConstants, Node, State, Values, spread
from data_recipes.deformers.pose_curves import SHARPNESS, saturate
from data_recipes.deformers.posed_props import NEAREST, RestProp, gaze_rotation
from data_recipes.head.eyes import eyeball
from data_recipes.ict.facekit_files import FaceKit
from data_recipes.recipe.facekit import Parts
from data_recipes.recipe.reading import Recipe
from data_recipes.recipe.sections import Eyes


def effective(constants: FaceConstants, params: Float[Values, "b m"]) -> Float[Array, "b m"]:
    """Return the controls' effective values: bent towards their limits, and some scaled by others.

    Looks and squints don't move the lids of a shut eye: `blink` (m, m) is 1 where the row's control shuts the column's
    lids. Lips close only over an open jaw: `gate` (m, m) is 1 where the row's control opens the column's, and `free`
    (m,) is 0 for those, 1 for all others.
    """
    controls = constants["controls"]
    u = saturate(constants["limits"], params * controls["stretch"])
    u = u * (1 - jnp.clip(u @ controls["blink"], 0.0, 1.0))
    return u * (controls["free"] + u @ controls["gate"])


def limit(constants: FaceConstants, state: State) -> State:
    """Bend the parameters towards their limits."""
    return state | {"u": effective(constants, state["p"])}


def add_shapes(constants: FaceConstants, state: State) -> State:
    """Sum the expressions, and bound each vertex's sum by a little more than any one of them moves it."""
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


# The eyeballs, for pictures only: they turn with the looks.

EYE = {"iris_deg": 27.0, "pupil_deg": 11.0, "iris_colour": (0.33, 0.42, 0.50)}
LOOK_DEG = {"out": 32.0, "in": 32.0, "up": 24.0, "down": 30.0}  # at 1; the model's shapes move the lids alone
LETTER = {"left": "L", "right": "R"}


def rest_props(model: FaceKit, parts: Parts) -> tuple[RestProp, ...]:
    """Return eyeballs at rest: ours, in the places and sizes of the model's."""
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
    """Return the posed props, each as name, vertices (k, 3), faces and colours (k, 3).

    constants: of the chain's nodes.
    columns: control → column of `params`.
    vertices, neutral: the skin, posed and at rest; a part of the contract of chains that eyeballs don't need.
    """
    u = np.asarray(effective(constants, jnp.asarray(params)))[0]
    parts = {prop.follow: [p.vertices for p in props if p.follow == prop.follow] for prop in props}
    centres = {eye: sphere_centre(np.concatenate(vertices)) for eye, vertices in parts.items()}
    meshes = []
    for prop in props:
        centre = centres[prop.follow]
        x = (prop.vertices - centre) @ gaze_rotation(*_look(u, columns, prop.follow.removeprefix("eye_"))) + centre
        meshes.append((prop.name, x.astype(np.float32), prop.faces, prop.colours))
    return meshes


def _look(u: np.ndarray, columns: dict[str, int], side: str) -> tuple[float, float]:
    """Return how far an eye looks towards +x and up, in radians."""
    amount = {}
    for direction, degrees in LOOK_DEG.items():
        column = columns.get(f"eyeLook{direction.capitalize()}_{LETTER[side]}")
        amount[direction] = 0.0 if column is None else np.deg2rad(degrees) * u[column]
    outwards = amount["out"] - amount["in"]
    return outwards if side == "left" else -outwards, amount["up"] - amount["down"]


# The chain of faces in ICT-FaceKit's format: their nodes, and how their eyeballs are posed.

FACEKIT = Chain("ict", NODES, pose)
