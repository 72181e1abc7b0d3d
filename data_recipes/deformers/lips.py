"""Lips: sticky corners, contact, and rolling over the teeth (layer 6).

The mouth's rings share columns: column i of the upper lip faces column k − i of the lower. A motion of a
column moves its rings by shares that fall off away from the seam.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from data_recipes.deformers.jaw import JawMotion, turn_with_jaw, undo_jaw
from data_recipes.deformers.node_chain import Constants, Values, place_of, selection, spread
from data_recipes.deformers.pose_curves import hinge

STICK_MM = 2.2  # gap at which corners at rest let go
STICK_REACH_MM = 16.0  # added to it by a full sticky control
EASE = 0.6  # share of its way up to the nose that the upper lip goes freely
UPPER_SHARE = 0.35  # of a closing gap that the upper lip bridges; the lower lip does the rest
WALL_DEGREE = 6
BEYOND_END = 0.3  # how far the wall of a row of teeth goes on past its end, as a difference of cosines
LIP_CLEARANCE_MM = 2.0


def prepare(
    neutral: Float[np.ndarray, "n 3"],
    rings: Int[np.ndarray, "r k"],
    shares: Float[np.ndarray, " r"],
    columns: Int[np.ndarray, " 3"],
    m: int,
    headroom_mm: Float[np.ndarray, " k"],
) -> dict[str, np.ndarray]:
    """Return the constants of the seam's closing.

    neutral: positions, mm
    rings: vertex indices; ring 0 is the seam, the first column the left corner, then over the upper lip
    shares: how much of the seam's motion each ring takes
    columns: of p, for "lips_together", "sticky_left" and "sticky_right"
    m: the number of controls
    headroom_mm: how far each column of the upper lip can rise before it meets the nose
    """
    k = rings.shape[1]
    half = k // 2
    upper = np.arange(1, half)
    # Columns are smoothed lightly, so that a contact in one column doesn't crease the lip.
    blur = np.zeros((k, k))
    for i in range(k):
        blur[i, [i, (i - 1) % k, (i + 1) % k]] = 0.6, 0.2, 0.2
    corner = np.zeros((half - 1, k))
    corner[np.arange(half - 1), upper] = 1
    mirrored = np.zeros((half - 1, k))
    mirrored[np.arange(half - 1), k - upper] = 1
    x = neutral[rings[0, upper], 0]
    left = np.clip(0.5 + x / (2 * max(np.abs(x).max(), 1e-6)), 0, 1)
    support = rings.ravel()
    return {
        "upper": rings[0, upper].astype(np.int32),
        "lower": rings[0, k - upper].astype(np.int32),
        "rest_y": neutral[rings[0, upper], 1].astype(np.float32),
        "headroom": headroom_mm[upper].astype(np.float32),
        "rest_gap": (neutral[rings[0, upper]] - neutral[rings[0, k - upper]]).T.astype(np.float32),
        "to_upper": (corner @ blur.T).astype(np.float32),
        "to_lower": (mirrored @ blur.T).astype(np.float32),
        "left": left.astype(np.float32),
        "shares": shares.astype(np.float32),
        "controls": selection(columns, m),
        "place": place_of(support, len(neutral)),
    }


def close_lips(constants: Constants, x: Float[Array, "b 3 n"], u: Float[Array, "b m"]) -> Float[Array, "b 3 n"]:
    """Return positions with corners stuck together, lips pressed shut by their control, and no lip inside the other.

    Nor does the upper lip rise into the nose, however many actions raise it.
    """
    value = u @ constants["controls"]
    together, sticky_left, sticky_right = (value[:, i : i + 1] for i in range(3))
    upper = x[:, :, constants["upper"]]
    too_high = stop_below(upper[:, 1] - constants["rest_y"], constants["headroom"])
    sinking = jnp.stack([jnp.zeros_like(too_high), -too_high, jnp.zeros_like(too_high)], axis=1)
    gap = upper + sinking - x[:, :, constants["lower"]] - constants["rest_gap"][None]
    size = jnp.sqrt((gap * gap).sum(axis=1) + 1e-8)
    left = constants["left"]
    sticky = jnp.maximum(sticky_left * left + sticky_right * (1 - left), 0.0)
    reach = STICK_MM + STICK_REACH_MM * sticky
    stick = jnp.exp(-((size / reach) ** 2))
    pull = stick + (1 - stick) * jnp.clip(together, 0.0, 1.0)
    # Closed lips may press but not pass: an overlap along y is removed in full, whatever the pull.
    overlap = hinge(-(gap[:, 1] * (1 - pull)), 0.05)
    part = jnp.stack([jnp.zeros_like(overlap), overlap, jnp.zeros_like(overlap)], axis=1)
    down = pull[:, None] * gap
    to_upper = sinking - UPPER_SHARE * down + 0.5 * part
    to_lower = (1 - UPPER_SHARE) * down - 0.5 * part
    seam = to_upper @ constants["to_upper"] + to_lower @ constants["to_lower"]  # (b, 3, k)
    rings = seam[:, :, None] * constants["shares"][:, None]
    return x + spread(rings.reshape(len(x), 3, -1), constants["place"])


def stop_below(rise_mm: Float[Array, "b c"], headroom_mm: Float[Values, " c"]) -> Float[Array, "b c"]:
    """Return how far a rise must be taken back to end within the headroom; up to `EASE` of it, not at all."""
    free = EASE * headroom_mm
    return hinge(rise_mm - free, 2 * (headroom_mm - free))


def fit_wall(teeth: Float[np.ndarray, "t 3"], axis_z: float) -> Float[np.ndarray, " d"]:
    """Return the outer wall of a row of teeth: radius about the axis (0, y, axis_z) as a polynomial in cos θ.

    θ is the angle from straight ahead. The polynomial is fitted to the outermost point in each range of angles.
    """
    radius = np.hypot(teeth[:, 0], teeth[:, 2] - axis_z)
    angle = np.arctan2(np.abs(teeth[:, 0]), teeth[:, 2] - axis_z)
    bins = np.linspace(0, angle.max(), 25)
    place = np.clip(np.digitize(angle, bins) - 1, 0, 23)
    outer = np.array([np.where(place == b, radius, -np.inf).argmax() for b in range(24) if (place == b).any()])
    cosine = np.cos(angle[outer])
    return np.polynomial.polynomial.polyfit(cosine, radius[outer], min(WALL_DEGREE, max(len(outer) - 2, 1)))


def prepare_wall(
    neutral: Float[np.ndarray, "n 3"],
    vertices: Int[np.ndarray, " s"],
    teeth: Float[np.ndarray, "t 3"],
    axis_z: float,
    upper: bool,
    pivot: Float[np.ndarray, " 3"],
    clearance_mm: float = LIP_CLEARANCE_MM,
) -> dict[str, np.ndarray]:
    """Return the constants of one row of teeth as an obstacle to lip and cheek.

    neutral: positions, mm
    vertices: mesh indices of lip and cheek
    teeth: points of the row, mm
    axis_z: z of the wall's upright axis
    upper: whether it is the upper row
    pivot: of the jaw, mm
    clearance_mm: how near thick flesh comes to the teeth; thin flesh comes nearer
    """
    wall = fit_wall(teeth, axis_z)
    widest = np.abs(teeth[:, 0]).argmax()
    cos_end = np.cos(np.arctan2(np.abs(teeth[widest, 0]), teeth[widest, 2] - axis_z))
    x = neutral[vertices]
    radius = np.hypot(x[:, 0], x[:, 2] - axis_z)
    cosine = np.maximum((x[:, 2] - axis_z) / np.maximum(radius, 1e-6), cos_end)
    free = radius - np.polynomial.polynomial.polyval(cosine, wall)
    near = free > -1.5
    vertices, free = vertices[near], free[near]
    return {
        "support": vertices.astype(np.int32),
        "place": place_of(vertices, len(neutral)),
        "wall": np.pad(wall, (0, WALL_DEGREE + 1 - len(wall))).astype(np.float32),
        # Vertices keep their order outwards when all are pressed: no lining comes through its lip.
        "clearance": np.where(free > 0, clearance_mm * free / (np.maximum(free, 0) + clearance_mm), free).astype(
            np.float32
        ),
        "axis_z": np.asarray(axis_z, np.float32),
        # Past the teeth's edge there is nothing to roll over. Past the last tooth the wall goes on as a circle and
        # fades out: else a corner drawn far back would cut behind the row, and its end would stick out.
        "edge_y": np.asarray(teeth[:, 1].min() if upper else teeth[:, 1].max(), np.float32),
        "side": np.asarray(1.0 if upper else -1.0, np.float32),
        "cos_end": np.asarray(cos_end, np.float32),
        "pivot": np.asarray(pivot, np.float32),
    }


def roll_over_teeth(constants: Constants, x: Float[Array, "b 3 n"], motion: JawMotion) -> Float[Array, "b 3 n"]:
    """Return positions pushed out of a row of teeth; the lower row rides on the jaw."""
    support_x = x[:, :, constants["support"]]
    lower = constants["side"] < 0
    still = JawMotion(jnp.where(lower, motion.rotation, 0.0), jnp.where(lower, motion.translation, 0.0))
    q = undo_jaw(constants["pivot"], support_x, still)
    z = q[:, 2] - constants["axis_z"]
    radius = jnp.sqrt(q[:, 0] ** 2 + z**2 + 1e-6)
    cosine = z / radius
    beside = jnp.maximum(cosine, constants["cos_end"])
    wall = constants["wall"][-1] * jnp.ones_like(cosine)
    for coefficient in constants["wall"][-2::-1]:
        wall = wall * beside + coefficient
    depth = wall + constants["clearance"] - radius
    # Full beside the teeth, none 3 mm past their edge or well past their end.
    past_edge = jnp.clip((constants["side"] * (q[:, 1] - constants["edge_y"]) + 3.0) / 3.0, 0.0, 1.0)
    past_end = jnp.clip((cosine - constants["cos_end"]) / BEYOND_END + 1.0, 0.0, 1.0)
    push = hinge(depth, 0.3) * past_edge * past_end
    out = jnp.stack([q[:, 0] / radius, jnp.zeros_like(z), cosine], axis=1) * push[:, None]
    return x + spread(turn_with_jaw(out, still), constants["place"])
