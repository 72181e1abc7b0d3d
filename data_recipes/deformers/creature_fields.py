"""Actions of a creature beyond those of a human face: frills, ears, a snarl along the snout, a pouch (layer 1)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from data_recipes.deformers.face_fields import fade
from data_recipes.deformers.mouth_fields import Curve, LipAction, Motion
from data_recipes.deformers.mouth_fields import sculpt as sculpt_lips
from data_recipes.deformers.sculpting import Path, Sculptor
from data_recipes.head.ears import ear_frame
from data_recipes.head.frills import frill_frame, frill_settings
from data_recipes.head.shape import smoothstep

RAISE_RAD, SPREAD_RAD = np.deg2rad(26.0), np.deg2rad(36.0)
EAR_SPREAD_RAD, EAR_FOLD_RAD = np.deg2rad(28.0), np.deg2rad(40.0)


def sculpt(s: Sculptor) -> dict[str, Path]:
    """Return the actions by name; "*" stands for the left side."""
    return frills(s) | ears(s) | snout(s)


def turn_about(
    s: Sculptor, vertices: np.ndarray, pivot: np.ndarray, axis: np.ndarray, angle: Float[np.ndarray, " k"]
) -> Path:
    """Return the path of vertices that turn about an axis.

    vertices: mesh indices of the k that turn
    pivot: (3,), a point on the axis, mm
    axis: (3,), its direction, of any length
    angle: by how much each turns at the full pose, radians
    """
    axis = axis / np.linalg.norm(axis)
    arm = s.x[vertices] - pivot
    offsets = []
    for share in (0.5, 1.0):
        sine, cosine = np.sin(share * angle)[:, None], np.cos(share * angle)[:, None]
        turned_arm = arm * cosine + np.cross(axis, arm) * sine + axis * (arm @ axis)[:, None] * (1 - cosine)
        offset = np.zeros_like(s.x)
        offset[vertices] = turned_arm - arm
        offsets.append(offset)
    still = np.zeros(s.n)
    return Path(*offsets, still, still)


def frills(s: Sculptor) -> dict[str, Path]:
    """Return two actions of each pair: its tips rise in its plane, and it spreads off the head; tips turn the most."""
    paths = {}
    for name, settings in frill_settings(s.head.recipe).items():
        grid = s.head.grids[f"frill_{name}_left"]
        along, across, front = frill_frame(settings)
        root = s.x[grid[:2].ravel()].mean(axis=0)
        share = np.broadcast_to(np.linspace(0.5, 1.0, len(grid))[:, None], grid.shape).ravel()
        up = 1.0 if across[1] + 0.3 * across[0] >= 0 else -1.0
        paths[f"frill_{name}_raise_*"] = turn_about(
            s, grid.ravel(), root, up * np.cross(along, across), RAISE_RAD * share
        )
        paths[f"frill_{name}_spread_*"] = turn_about(s, grid.ravel(), root, np.cross(along, front), SPREAD_RAD * share)
    return paths


def ears(s: Sculptor) -> dict[str, Path]:
    """Return the actions that turn the ears outwards and lay them back."""
    rings = s.head.grids["ear_left"]
    share = np.ones(s.n)
    for j, ring in enumerate(rings):
        share[ring] = smoothstep(np.array(1 - j / (len(rings) - 1)), 0.0, 0.45)
    ear = np.union1d(np.flatnonzero(s.in_parts("ear_left")), rings.ravel())
    root, (back, _, out) = s.x[rings[-1]].mean(axis=0), ear_frame(s.head.recipe)
    return {
        "ear_spread_*": turn_about(s, ear, root, np.cross(back, out), EAR_SPREAD_RAD * share[ear]),
        "ear_fold_*": turn_about(s, ear, root, np.array([-1.0, 0.0, 0.0]), EAR_FOLD_RAD * share[ear]),
    }


def _snarl(u: Curve, side: Curve) -> Motion:
    lift = (side > 0) * np.exp(-(((np.abs(u) - 0.55) / 0.26) ** 2)) * (1 - np.abs(u) ** 6)
    return 0 * u, 8.0 * lift, -1.5 * lift


def _jowl(u: Curve, side: Curve) -> Motion:
    sag = (side < 0) * np.exp(-(((np.abs(u) - 0.60) / 0.26) ** 2)) * (1 - np.abs(u) ** 6)
    return 0 * u, -8.0 * sag, 1.5 * sag


def snout(s: Sculptor) -> dict[str, Path]:
    """Return the snarl and the jowl along the sides of the mouth, brow ridges, throat pouch and the tongue's hump."""
    side, lids, lips = smoothstep(s.x[:, 0], -6, 6), fade(s, "eye"), fade(s, "mouth")
    corner, wing = s.point("mouth_corner_left"), s.point("nose_wing_left")
    flank = s.bump(s.nearest(0.45 * corner + 0.55 * wing + np.array([8.0, 10.0, 0.0])), 34.0) * lids * lips
    ridge = np.maximum(s.bump("brow_mid_left", 30.0), s.bump("brow_outer_left", 30.0)) * lids
    chin = s.point("chin")
    throat = s.bump(s.nearest(np.array([0.0, chin[1] - 30.0, 0.45 * chin[2]])), 62.0)
    t = np.zeros(s.n)
    for j, ring in enumerate(s.head.grids["tongue"]):
        t[ring] = j / max(len(s.head.grids["tongue"]) - 1, 1)
    hump = 0.16 * s.head.recipe.tongue.length * np.sin(np.pi * np.clip(t, 0, 1)) ** 2
    still = np.zeros_like(s.x)
    return {
        "snarl_*": sculpt_lips(s, LipAction(_snarl, _snarl))
        + s.slide(4.0 * (flank * side)[:, None] * s.up, 3.0 * flank),
        "jowl_*": sculpt_lips(s, LipAction(_jowl, _jowl)),
        "brow_ridge_*": s.slide(3.0 * ridge[:, None] * s.up, 4.5 * ridge),
        "throat_pouch": s.straight(still, 14.0 * throat * lips),
        "tongue_hump": s.straight(hump[:, None] * np.array([0.0, 1.0, 0.0])),
    }
