"""Lids turn on the lid ball: elevation + b·w·(closed − elevation), and they collide with the eyes (layer 5).

Directions from an eye's centre are taken in the eye's frame: azimuth towards the temple, elevation upwards. Each lid
vertex belongs to a column of the rim. The controls raise and lower the rim's upper and lower edges (linear), the blink
closes them, and they can't pass each other; the vertex then follows its edge by its ring's share w.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from data_recipes.deformers.node_chain import Constants, Values, place_of, selection, sine_cosine, spread
from data_recipes.deformers.pose_curves import hinge

CLOSED_SHARE = 0.22  # where closed lids meet, between the lower edge (0) and the upper one (1)
CLEARANCE_MM = 0.3  # lids stay this far from the eyeball, unless they rest closer
FULL_TURN_RAD = 0.55
LEAN = 0.75  # share of its way to the lid ball by which a lid turned that far is drawn onto it


@dataclass(frozen=True)
class LidPatch:
    """The s lid vertices of one eye.

    vertices: mesh indices
    share: w, from 1 at the rim to 0
    upper: 1 on the upper lid, 0 on the lower, ½ at the corners
    edge_upper, edge_lower: elevation of the rim's edges at rest in the vertex's column, radians
    moves_upper, moves_lower: elevation that each control gives these edges, radians
    lifts, swells: elevation (radians) and distance (mm) that each control gives the vertex itself
    """

    vertices: Int[np.ndarray, " s"]
    share: Float[np.ndarray, " s"]
    upper: Float[np.ndarray, " s"]
    edge_upper: Float[np.ndarray, " s"]
    edge_lower: Float[np.ndarray, " s"]
    moves_upper: Float[np.ndarray, "m s"]
    moves_lower: Float[np.ndarray, "m s"]
    lifts: Float[np.ndarray, "m s"]
    swells: Float[np.ndarray, "m s"]


def to_frame(frame: Float[Values, "3 3"], centre: Float[Values, " 3"], x: Float[Values, "b 3 s"]) -> Array:
    """Return positions relative to the eye's centre, in its frame: towards the temple, up, along the gaze."""
    return jnp.einsum("ij,bjs->bis", frame, x - jnp.asarray(centre)[:, None])


def from_frame(frame: Float[Values, "3 3"], centre: Float[Values, " 3"], q: Float[Values, "b 3 s"]) -> Array:
    """Return positions from the eye's frame: the inverse of `to_frame`."""
    return jnp.einsum("ij,bis->bjs", frame, q) + jnp.asarray(centre)[:, None]


def raise_on_ball(
    q: Float[Values, "b 3 s"], angle: Float[Values, "b s"], distance: Float[Values, "b s"]
) -> Float[Array, "b 3 s"]:
    """Return points with their elevation raised by `angle` (radians) at the same azimuth, at the given distances.

    It turns (across, up) in the plane through the eye's upright axis, so that no arc tangent is taken.
    """
    flat = q[:, 0] ** 2 + q[:, 2] ** 2 + 1e-9
    across = jnp.sqrt(flat)
    length = jnp.sqrt(flat + q[:, 1] ** 2)
    sine, cosine = sine_cosine(angle)
    scale = distance / length
    outwards = scale * (cosine - q[:, 1] / across * sine)
    upwards = scale * (q[:, 1] * cosine + across * sine)
    return jnp.stack([q[:, 0] * outwards, upwards, q[:, 2] * outwards], axis=1)


def prepare(
    neutral: Float[np.ndarray, "n 3"],
    patch: LidPatch,
    frame: Float[np.ndarray, "3 3"],
    centre: Float[np.ndarray, " 3"],
    radius_mm: float,
    blink_column: int,
) -> dict[str, np.ndarray]:
    """Return the constants of one eye.

    neutral: positions, mm
    patch: the lid vertices
    frame: rows towards the temple, up, and along the gaze
    centre: of the eyeball, mm
    radius_mm: of the eyeball
    blink_column: of p, m or more for none
    """
    x = neutral[patch.vertices]
    distance = np.linalg.norm(x - centre, axis=1)
    used = np.flatnonzero(
        sum(np.abs(m).max(axis=1) for m in (patch.moves_upper, patch.moves_lower, patch.lifts, patch.swells)) > 0
    )
    arrays = {
        "share": patch.share,
        "upper": patch.upper,
        "edge_upper": patch.edge_upper,
        "edge_lower": patch.edge_lower,
        "moves": np.stack([patch.moves_upper, patch.moves_lower, patch.lifts, patch.swells], axis=1)[used],
        "ball": np.full(len(x), radius_mm) + np.minimum(CLEARANCE_MM, distance - radius_mm),
        "lid_ball": distance[np.argmax(patch.share)] * np.ones(len(x)),
        "rest_distance": distance,
        "frame": frame,
        "centre": centre,
    }
    return {name: np.asarray(value, np.float32) for name, value in arrays.items()} | {
        "used": used.astype(np.int32),
        "blink": selection(np.array([blink_column]), len(patch.moves_upper)),
        "support": patch.vertices.astype(np.int32),
        "place": place_of(patch.vertices, len(neutral)),
    }


def closing(blink: Float[Array, "b 1"]) -> Float[Array, "b 1"]:
    """Return how far the lids close, from the blink control: linear at first, exactly 1 from a full blink on."""
    v = 1.14 * blink
    return v - hinge(v - 0.9, 0.2)


def edges(constants: Constants, u: Float[Array, "b m"]) -> tuple[Array, Array, Array, Array]:
    """Return the upper and the lower edge's elevation (radians) in each vertex's column, then lifts and swells."""
    used = u[:, constants["used"]]
    moves = jnp.einsum("bk,kqs->qbs", used, constants["moves"])
    rest_upper, rest_lower = constants["edge_upper"], constants["edge_lower"]
    meeting_line = rest_lower + CLOSED_SHARE * (rest_upper - rest_lower)
    b = closing(u @ constants["blink"])
    upper = rest_upper + moves[0]
    lower = rest_lower + moves[1]
    upper = upper + b * (meeting_line - upper)
    lower = lower + b * (meeting_line - lower)
    # Where they would cross they meet half-way; at rest, and wherever they are apart, this is exactly 0.
    overlap = 0.5 * hinge(lower - upper, 0.02)
    return upper + overlap, lower - overlap, moves[2], moves[3]


def close_lids(constants: Constants, x: Float[Array, "b 3 n"], u: Float[Array, "b m"]) -> Float[Array, "b 3 n"]:
    """Return positions with one eye's lids turned, drawn onto the lid ball, and pushed out of the eyeball."""
    support_x = x[:, :, constants["support"]]
    frame, centre = constants["frame"], constants["centre"]
    q = to_frame(frame, centre, support_x)
    distance = jnp.sqrt((q * q).sum(axis=1) + 1e-9)
    edge_upper, edge_lower, lift, swell = edges(constants, u)
    side = constants["upper"]
    turn = side * (edge_upper - constants["edge_upper"]) + (1 - side) * (edge_lower - constants["edge_lower"])
    turn = turn * constants["share"]
    # A vertex drawn down over the ball lies on it as the rim does; rim vertices stay where their thickness puts them.
    lean = LEAN * jnp.minimum(turn * turn / FULL_TURN_RAD**2, 1.0)
    outside = jnp.maximum(constants["rest_distance"] - constants["lid_ball"], 0.0)
    distance = distance - lean * outside + swell
    ball = constants["ball"]
    distance = distance + hinge(ball - distance, 0.1)
    target_x = from_frame(frame, centre, raise_on_ball(q, turn + lift, distance))
    return x + spread(target_x - support_x, constants["place"])
