"""Brow and scalp actions: the brow moves, and the forehead follows evenly up to the hair line (layer 1).

The raise is a harmonic field that is 1 along the brow and 0 at the hair line and the lids. It falls linearly between
them, so that strain, and with it wrinkles, spread evenly over the forehead.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from data_recipes.deformers.lids import LidPatch
from data_recipes.deformers.sculpting import Path, Sculptor
from data_recipes.head.shape import smoothstep

RAISE_MM = 12.5
LOWER_MM = 11.0


def brow_row_field(s: Sculptor) -> Float[np.ndarray, " n"]:
    """Return the field that is 1 along both brows and 0 at hair line, lids, temples and the bridge of the nose."""
    # where it is 0
    head = s.head
    body, rings = head.grids["body"], head.grids["eye_left"]
    crown = head.grids["crown"].ravel()
    hair = head.curves["hairline"]
    t = head.recipe.template
    above = body[t.hair_row :]
    neck = body[: t.neck_rows]
    lids = np.concatenate([head.grids[f"eye_{side}"][: max(len(rings) // 4, 1)].ravel() for side in ("left", "right")])
    half = body.shape[1] // 2
    back = body[:, t.ear_columns[0] : 2 * half - t.ear_columns[0] + 1]
    low = body[: t.eye_rows[0] + (t.eye_rows[1] - t.eye_rows[0]) // 2]
    still = np.concatenate([hair, crown, above[above >= 0], lids, back[back >= 0], low[low >= 0], neck[neck >= 0]])
    for grid in ("lid_inner_left", "lid_inner_right", "mouth_bag", "mouth", "ear_left", "ear_right"):
        still = np.concatenate([still, head.grids[grid].ravel()])
    # where it is 1
    brows = np.concatenate([head.curves["brow_left"], head.curves["brow_right"]])
    row = int(np.argwhere(body == brows[0])[0, 0])
    between = body[row, list(range(-t.eye_columns[0], t.eye_columns[0] + 1))]
    brow_line = np.concatenate([brows, between[between >= 0]])
    # Up the forehead's columns the field is 1 − s, s the arc length from brow to hair line: an even strain.
    reach = t.eye_columns[1] - 1
    columns = body[row : t.hair_row + 1][:, list(range(-reach, reach + 1))]
    steps = np.linalg.norm(np.diff(s.x[columns], axis=0), axis=2)
    arc = np.concatenate([np.zeros((1, columns.shape[1])), np.cumsum(steps, axis=0)])
    ramp = 1 - arc / arc[-1]
    whole = (columns >= 0).all()
    even = (columns.ravel(), ramp.ravel()) if whole else (brow_line, 1.0)
    return s.blend((brow_line, 1.0), even, (still, 0.0), passes=4)


def across(s: Sculptor) -> Float[np.ndarray, " n"]:
    """Return how far out along the left brow a vertex lies: 0 at its inner end, 1 at its outer one, unclipped."""
    inner, outer = s.point("brow_inner_left"), s.point("brow_outer_left")
    angle = np.arctan2(s.x[:, 0], s.x[:, 2] - s.head.mouth_axis[0])
    low, high = (np.arctan2(p[0], p[2] - s.head.mouth_axis[0]) for p in (inner, outer))
    return (angle - low) / (high - low)


def sculpt(s: Sculptor) -> dict[str, Path]:
    """Return the brow actions by name; "*" stands for the left side."""
    row = brow_row_field(s)
    h = across(s)
    left = smoothstep(h, -0.75, 0.15)  # adds up with its mirror image to about 1 on the glabella
    inner = left * smoothstep(h, 0.85, 0.15)
    outer = left * smoothstep(h, 0.15, 0.75) * smoothstep(h, 1.75, 1.1)
    paths = {
        "brow_inner_up_*": s.slide(RAISE_MM * (row * inner)[:, None] * s.up),
        "brow_outer_up_*": s.slide(RAISE_MM * (row * outer)[:, None] * s.up),
    }
    # Frowning: the whole brow sinks and moves inwards; skin piles up over the nose and above the eyes.
    sink = s.bump("brow_inner_left", 46.0) * 0.75 + s.bump("brow_mid_left", 42.0) * 0.45 + 0.15 * row * left
    sink = sink * smoothstep(h, -0.65, 0.0) * _off_lids(s)
    offset = sink[:, None] * (-LOWER_MM * s.up - 2.2 * s.out)
    ridge = 1.6 * s.bump("brow_inner_left", 22.0) * smoothstep(h, -0.4, 0.0)
    paths["brow_down_*"] = s.slide(offset, ridge)
    squeeze = s.bump("brow_inner_left", 36.0) * smoothstep(h, -0.6, -0.05) * _off_lids(s)
    offset = squeeze[:, None] * (-5.5 * s.out + 0.6 * s.up)
    paths["brow_squeeze_*"] = s.slide(offset, 0.8 * s.bump("brow_inner_left", 16.0) * smoothstep(h, -0.4, 0.0))
    paths["scalp_raise"] = s.slide(4.5 * _scalp(s)[:, None] * s.up)
    return paths


def _off_lids(s: Sculptor) -> Float[np.ndarray, " n"]:
    """Return 0 on the lids' inner rings, rising to 1 at the outermost ring and beyond."""
    weight = np.ones(s.n)
    for side in ("left", "right"):
        rings = s.head.grids[f"eye_{side}"]
        for j, ring in enumerate(rings[:-1]):
            weight[ring] = smoothstep(np.array(j / (len(rings) - 1)), 0.15, 0.95)
        weight[s.head.grids[f"lid_inner_{side}"]] = 0
    return weight


def _scalp(s: Sculptor) -> Float[np.ndarray, " n"]:
    t = s.head.recipe.template
    body, crown = s.head.grids["body"], s.head.grids["crown"]
    low = body[: t.eye_rows[1] + 1]
    back = body[:, t.coarse_from : body.shape[1] - t.coarse_from + 1]
    ears = [s.head.grids[f"ear_{side}"].ravel() for side in ("left", "right")]
    eyes = [s.head.grids[f"eye_{side}"].ravel() for side in ("left", "right")]
    still = np.concatenate([low[low >= 0], back[back >= 0], *ears, *eyes, s.head.grids["mouth_bag"].ravel()])
    still = np.setdiff1d(still, s.head.curves["hairline"])
    front = np.setdiff1d(crown[: max(len(crown) // 5, 1)].ravel(), still)
    return s.blend(
        (s.head.curves["hairline"], 1.0), (front, 0.8), (crown[len(crown) // 2 :].ravel(), 0.0), (still, 0.0)
    )


# What each control does to an eye's lids: to their edges, creases and bags, as elevations and distances from the eye.

RAD = np.pi / 180  # of a degree
GAZE_PRODUCTS = tuple(f"gaze_{part}_{side}" for side in ("left", "right") for part in ("upper", "lower", "aside"))
# How far the edges follow the gaze (radians per full look): upper lid, lower lid.
FOLLOW = (9.0 * RAD, 5.0 * RAD)


def ball_angles(s: Sculptor, side: str, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return azimuth, elevation (radians) and distance (mm) of vertices from an eye's centre, in its frame."""
    eye = s.head.eyes[side]
    q = (s.x[vertices] - eye.centre) @ np.asarray(eye.frame).T
    distance = np.linalg.norm(q, axis=-1)
    return np.arctan2(q[..., 0], q[..., 2]), np.arcsin(q[..., 1] / np.maximum(distance, 1e-9)), distance


def ring_shares(count: int) -> Float[np.ndarray, " r"]:
    """Return w of each eye ring: 1 at the rim, 0 at the outermost, falling smoothly."""
    t = np.linspace(0, 1, count)
    return (1 - smoothstep(t, 0.0, 1.0)) * (1 - 0.25 * t)


def build_patch(s: Sculptor, side: str, columns: dict[str, int], m: int) -> LidPatch:
    """Return an eye's lid patch, with all that the controls do to it.

    columns: each control's column of p; controls that are missing there are left out
    m: the number of columns
    """
    # rings of the outer and the inner lid, and the edges that they follow
    head = s.head
    outer, inner = head.grids[f"eye_{side}"][:-1], head.grids[f"lid_inner_{side}"]
    rings = np.concatenate([outer, inner])
    share = np.concatenate([ring_shares(len(outer) + 1)[:-1], np.linspace(1.0, 0.75, len(inner))])
    k = rings.shape[1]
    u, lid = head.ring_parameter["eye_u"], head.ring_parameter["eye_side"]
    _, rim, _ = ball_angles(s, side, outer[0])
    other = (-np.arange(k)) % k  # the same place on the other lid
    upper_edge, lower_edge = np.where(lid >= 0, rim, rim[other]), np.where(lid >= 0, rim[other], rim)
    upper = np.where(lid > 0, 1.0, np.where(lid < 0, 0.0, 0.5))
    ring_index = np.concatenate([np.arange(len(outer)), np.zeros(len(inner))])
    # how far the edges move
    moves = {name: np.zeros((m, k)) for name in ("upper", "lower")}
    lifts, swells = np.zeros((m, len(rings), k)), np.zeros((m, len(rings), k))
    arch = np.clip(1 - np.abs(u) ** 2.2, 0, 1)
    windows = {
        "middle": arch * np.exp(-((u / 0.5) ** 2)),
        "inner": arch * np.exp(-(((u + 0.62) / 0.36) ** 2)),
        "outer": arch * np.exp(-(((u - 0.62) / 0.36) ** 2)),
    }

    def edge(control: str, on: str, amount_rad: float, window: np.ndarray) -> None:
        if f"{control}_{side}" in columns:
            moves[on][columns[f"{control}_{side}"]] += amount_rad * window

    for part, window in windows.items():
        edge(f"lid_upper_{part}", "upper", 9.0 * RAD, window)
        edge(f"lid_lower_{part}", "lower", 8.0 * RAD, window)
    edge("eye_wide", "upper", 9.5 * RAD, arch**0.6)
    edge("eye_wide", "lower", -3.0 * RAD, arch**0.8)
    edge("squint", "upper", -5.0 * RAD, arch)
    edge("squint", "lower", 11.0 * RAD, arch**0.8)
    edge("cheek_raise", "lower", 6.5 * RAD, arch)
    edge("smile", "lower", 3.5 * RAD, arch)
    edge("brow_down", "upper", -3.5 * RAD, arch)
    edge("brow_outer_up", "upper", 1.5 * RAD, arch)
    edge("gaze_upper", "upper", FOLLOW[0], arch**0.7)
    edge("gaze_lower", "lower", FOLLOW[1], arch**0.7)
    # Looking aside, the cornea lifts the lid over it; u runs from nose to temple, look_x to the character's left.
    edge("gaze_aside", "upper", (2.5 if side == "left" else -2.5) * RAD, u * arch)

    # creases, bags and the outer corner
    def shape(control: str, on: str, low: float, high: float, window: np.ndarray, lift_rad: float, swell_mm: float):
        """Add a ridge to one lid, on the rings from `low` to `high` (shares of their count, from the rim outwards)."""
        if f"{control}_{side}" not in columns:
            return
        t = ring_index / max(len(outer) - 1, 1)
        ridge = np.sin(np.pi * np.clip((t - low) / (high - low), 0, 1)) ** 2
        ridge[len(outer) :] = 0
        mask = (lid > 0) if on == "upper" else (lid < 0)
        column = columns[f"{control}_{side}"]
        lifts[column] += lift_rad * ridge[:, None] * (mask * window)
        swells[column] += swell_mm * ridge[:, None] * (mask * window)

    shape("crease_height", "upper", 0.15, 0.95, arch, 6.0 * RAD, 0.0)
    shape("crease_depth", "upper", 0.15, 0.65, arch, 0.0, -2.0)
    shape("crease_inner", "upper", 0.2, 0.95, windows["inner"], -3.0 * RAD, 1.6)
    shape("crease_outer", "upper", 0.2, 0.95, windows["outer"], -4.0 * RAD, 2.0)
    shape("eyebag", "lower", 0.2, 1.0, arch, 0.0, 2.4)
    shape("squint", "lower", 0.15, 0.8, arch, 0.0, 1.1)
    if f"lid_corner_{side}" in columns:
        near = np.exp(-(((u - 1) / 0.3) ** 2))
        lifts[columns[f"lid_corner_{side}"]] += 5.0 * RAD * share[:, None] * near

    # the same on every ring
    count = len(rings)
    return LidPatch(
        vertices=rings.ravel().astype(np.int32),
        share=np.repeat(share, k),
        upper=np.tile(upper, count),
        edge_upper=np.tile(upper_edge, count),
        edge_lower=np.tile(lower_edge, count),
        moves_upper=np.tile(moves["upper"], count),
        moves_lower=np.tile(moves["lower"], count),
        lifts=lifts.reshape(m, -1),
        swells=swells.reshape(m, -1),
    )
