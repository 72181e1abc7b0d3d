"""The face: every deformer in its layer, from coarse to fine, as the nodes of a chain (see `node_chain`).

Besides parameters, controls and positions, the state holds two results that later layers need: the jaw's motion and the
head's shape.
"""

from __future__ import annotations

from dataclasses import fields

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from data_recipes.deformers import (
    flesh,
    handles,
    head_shape,
    jaw,
    lids,
    lips,
    pose_curves,
    riders,
    rigid_teeth,
    skull_slide,
    wrinkles,
)
from data_recipes.deformers.head_shape import ShapeValues
from data_recipes.deformers.jaw import JawMotion
from data_recipes.deformers.node_chain import FaceConstants, Node, State, Values
from data_recipes.deformers.pose_curves import saturate

JAW_CONTROLS = ("jaw_open", "jaw_sideways", "jaw_forward", "jaw_drop", "jaw_twist")
# Rotation vector (x, y, z) in radians of each jaw control at 1, and translation in mm: the condyle glides.
TURN_RAD = np.deg2rad([(27.0, 0, 0), (0, 4.5, 0), (0, 0, 0), (0, 0, 0), (0, 0, -4.5)]).astype(np.float32)
GLIDE_MM = ((0.0, -1.0, 1.5), (5.0, 0.0, 0.0), (0.0, -0.8, 6.0), (0.0, -7.0, -1.0), (0.0, 0.0, 0.0))
HEAD_CONTROLS = tuple(f.name for f in fields(ShapeValues))
GAZE_PARTS = ("look_y", "follow_upper", "follow_lower", "look_x", "follow_aside")
GAZE = tuple(f"{part}_{side}" for side in ("left", "right") for part in GAZE_PARTS)
ASIDE_GAIN = 2.0  # at 1 of follow_aside: by themselves, lids follow the gaze little to the side


def limit(constants: FaceConstants, state: State) -> State:
    """Bend the parameters towards their limits."""
    return state | {"u": saturate(constants["limits"], state["p"])}


def sculpt(constants: FaceConstants, state: State) -> State:
    """Move the skin along the curves of the sculpted fields (layer 1)."""
    return state | {"x": constants["neutral"] + pose_curves.move(constants["pose"], state["u"])}


def slide_on_skull(constants: FaceConstants, state: State) -> State:
    """Let the skin slide along the skull (layer 2)."""
    return state | {"x": state["x"] + skull_slide.slide(constants["slide"], state["x"] - constants["neutral"])}


def bulge_out(constants: FaceConstants, state: State) -> State:
    """Add bulges along the normals (layer 1), after the slide, which would take them back."""
    return state | {"x": state["x"] + pose_curves.move(constants["bulge"], state["u"])}


def shape_by_handles(constants: FaceConstants, state: State) -> State:
    """Move the skin with the free-form handles (layer 3)."""
    return state | {"x": state["x"] + handles.move(constants["handles"], state["u"])}


def jaw_motion(constants: FaceConstants, u: Float[Values, "b m"]) -> JawMotion:
    """Return the jaw's rotation vector (radians) and translation (mm) at controls u."""
    value = u @ constants["jaw_controls"]
    return JawMotion(value @ jnp.asarray(TURN_RAD), value @ jnp.asarray(GLIDE_MM))


def open_the_jaw(constants: FaceConstants, state: State) -> State:
    """Turn and shift the jaw (layer 4)."""
    motion = jaw_motion(constants, state["u"])
    return state | {"jaw": motion, "x": jaw.open_jaw(constants["jaw"], state["x"], motion)}


def gaze_controls(constants: FaceConstants, u: Float[Values, "b m"]) -> Float[Array, "b q"]:
    """Return u and six more controls: the gaze times each follow gain (see `upper_face_fields.GAZE_PRODUCTS`)."""
    value = u @ constants["gaze_controls"]
    products = []
    for up, upper, lower, aside, sideways in (value[:, :5].T, value[:, 5:].T):
        products += [up * (1 + upper), up * (1 + lower), aside * (1 + ASIDE_GAIN * sideways)]
    return jnp.concatenate([u, jnp.stack(products, axis=1)], axis=1)


def move_lids(constants: FaceConstants, state: State) -> State:
    """Turn the lids, one eye after the other (layer 5)."""
    u = gaze_controls(constants, state["u"])
    x = lids.close_lids(constants["lids_left"], state["x"], u)
    return state | {"x": lids.close_lids(constants["lids_right"], x, u)}


def close_lips(constants: FaceConstants, state: State) -> State:
    """Stick the corners of the lips together, and keep the lips out of each other (layer 6)."""
    return state | {"x": lips.close_lips(constants["lips"], state["x"], state["u"])}


def roll_lips(constants: FaceConstants, state: State) -> State:
    """Roll the lips over the teeth (layer 6)."""
    x = lips.roll_over_teeth(constants["wall_upper"], state["x"], state["jaw"])
    return state | {"x": lips.roll_over_teeth(constants["wall_lower"], x, state["jaw"])}


def even_out_flesh(constants: FaceConstants, state: State) -> State:
    """Even out the flesh (layer 7)."""
    return state | {"x": flesh.mush(constants["flesh"], state["x"])}


def fold_skin(constants: FaceConstants, state: State) -> State:
    """Raise wrinkles (layer 8)."""
    return state | {"x": wrinkles.wrinkle(constants["wrinkles"], state["x"], state["u"])}


def carry_riders(constants: FaceConstants, state: State) -> State:
    """Carry frills along with the skin in which they stand (after layer 8)."""
    return state | {"x": riders.ride(constants["riders"], state["x"])}


def shape_values(constants: FaceConstants, u: Float[Values, "b m"]) -> ShapeValues:
    """Return the head controls, (b, 1) each."""
    value = u @ constants["head_controls"]
    return ShapeValues(*(value[:, i : i + 1] for i in range(len(HEAD_CONTROLS))))


def warp_head(constants: FaceConstants, state: State) -> State:
    """Change the shape of the head, squash, bend and twist it (layer 9)."""
    values = shape_values(constants, state["u"])
    return state | {"shape": values, "x": head_shape.warp(constants["shape"], values, state["x"])}


def set_teeth(constants: FaceConstants, state: State) -> State:
    """Place the rigid teeth (layer 10)."""
    values = state["shape"]
    warp = lambda points: head_shape.warp(constants["shape"], values, points)  # noqa: E731
    return state | {"x": rigid_teeth.place_teeth(constants["teeth"], state["x"], state["jaw"], warp)}


NODES = (
    Node("limit", limit, ("limits",)),
    Node("pose_curves", sculpt, ("neutral", "pose")),
    Node("skull_slide", slide_on_skull, ("neutral", "slide")),
    Node("bulges", bulge_out, ("bulge",)),
    Node("handles", shape_by_handles, ("handles",)),
    Node("jaw", open_the_jaw, ("jaw_controls", "jaw")),
    Node("lip_contact", close_lips, ("lips",)),
    Node("teeth_contact", roll_lips, ("wall_upper", "wall_lower")),
    Node("lids", move_lids, ("gaze_controls", "lids_left", "lids_right")),
    Node("flesh", even_out_flesh, ("flesh",)),
    Node("wrinkles", fold_skin, ("wrinkles",)),
    Node("riders", carry_riders, ("riders",)),
    Node("head_shape", warp_head, ("head_controls", "shape")),
    Node("teeth", set_teeth, ("shape", "teeth")),
)
