"""What each control does to an eye's lids: edges, creases and bags, as elevations and distances on the lid ball.

Besides the rig's own controls there are products, `GAZE_PRODUCTS`: the gaze's height, or how far it goes aside, times
the lid's follow gain.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from data_recipes.deformers.lids import LidPatch
from data_recipes.deformers.sculpting import Sculptor, smoothstep

RAD = np.pi / 180
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
    """Return an eye's lid patch; `columns` gives each control's column of p, missing ones are left out."""
    head = s.head
    outer, inner = head.grids[f"eye_{side}"][:-1], head.grids[f"lid_inner_{side}"]
    rings = np.concatenate([outer, inner])
    share = np.concatenate([ring_shares(len(outer) + 1)[:-1], np.linspace(1.0, 0.75, len(inner))])
    k = rings.shape[1]
    u, lid = head.ring_parameter["eye_u"], head.ring_parameter["eye_side"]
    _, rim, _ = ball_angles(s, side, outer[0])
    other = (-np.arange(k)) % k  # the same place on the other lid
    upper_edge, lower_edge = np.where(lid >= 0, rim, rim[other]), np.where(lid >= 0, rim[other], rim)
    # On the ring's way round the corner, vertices pass from following the upper lid to the lower one.
    belongs = np.where(lid > 0, 1.0, np.where(lid < 0, 0.0, 0.5))
    ring_index = np.concatenate([np.arange(len(outer)), np.zeros(len(inner))])
    moves = {name: np.zeros((m, k)) for name in ("upper", "lower")}
    lifts, swells = np.zeros((m, len(rings), k)), np.zeros((m, len(rings), k))
    arch = np.clip(1 - np.abs(u) ** 2.2, 0, 1)
    windows = {
        "middle": arch * np.exp(-((u / 0.5) ** 2)),
        "inner": arch * np.exp(-(((u + 0.62) / 0.36) ** 2)),
        "outer": arch * np.exp(-(((u - 0.62) / 0.36) ** 2)),
    }

    def edge(control: str, which: str, amount_rad: float, window: np.ndarray) -> None:
        if f"{control}_{side}" in columns:
            moves[which][columns[f"{control}_{side}"]] += amount_rad * window

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

    def shape(control: str, on: str, low: float, high: float, window: np.ndarray, lift_rad: float, swell_mm: float):
        """Add a ridge on the rings from `low` to `high` (shares of the ring count) of one lid."""
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
    if f"lid_corner_{side}" in columns:  # the outer corner, up and down
        near = np.exp(-(((u - 1) / 0.3) ** 2))
        lifts[columns[f"lid_corner_{side}"]] += 5.0 * RAD * share[:, None] * near

    tile = np.broadcast_to
    shape_of = rings.shape
    return LidPatch(
        vertices=rings.ravel().astype(np.int32),
        share=tile(share[:, None], shape_of).ravel().copy(),
        upper=tile(belongs, shape_of).ravel().copy(),
        edge_upper=tile(upper_edge, shape_of).ravel().copy(),
        edge_lower=tile(lower_edge, shape_of).ravel().copy(),
        moves_upper=tile(moves["upper"][:, None], (m, *shape_of)).reshape(m, -1).copy(),
        moves_lower=tile(moves["lower"][:, None], (m, *shape_of)).reshape(m, -1).copy(),
        lifts=lifts.reshape(m, -1),
        swells=swells.reshape(m, -1),
    )
