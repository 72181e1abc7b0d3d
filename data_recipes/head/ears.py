"""Ears: an egg-shaped outline swept over the rim, into the fold behind it and down to the canal. Left ear; the right one mirrors it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from data_recipes.head.sdf import project
from data_recipes.head.shape import Shape, skin_distance
from data_recipes.recipe import Recipe

# (across, up, out, forward shift) of a ring: sizes as shares of the half width and half height, out in mm along the ear's axis
PROFILE = (
    (0.60, 0.86, 0.45, 0.0),   # behind: the neck of the ear
    (0.86, 0.96, 0.80, 0.0),
    (1.00, 1.00, 1.00, 0.0),   # outermost
    (0.97, 0.97, 1.14, 0.0),   # the rim's crest
    (0.88, 0.89, 1.12, 0.0),
    (0.79, 0.81, 0.92, 0.0),   # the groove inside the rim
    (0.68, 0.70, 0.84, 0.0),
    (0.57, 0.58, 0.95, 0.04),  # the inner fold
    (0.45, 0.45, 0.86, 0.12),
    (0.34, 0.34, 0.50, 0.22),  # the bowl
    (0.20, 0.22, 0.24, 0.34),
)


def ear_frame(recipe: Recipe) -> Float[np.ndarray, "3 3"]:
    """Return the left ear's axes as rows: backwards in its plane, up, and out of its plane."""
    lean, flare = np.radians(recipe.ears.lean_deg), np.radians(recipe.ears.flare_deg)
    back = np.array([np.sin(flare), 0.0, -np.cos(flare)])
    out = np.array([np.cos(flare), 0.0, np.sin(flare)])
    up = np.array([0.0, 1.0, 0.0])
    return np.stack([np.cos(lean) * back - np.sin(lean) * up, np.cos(lean) * up + np.sin(lean) * back, out])


def outline(recipe: Recipe, phase: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k 2"]:
    """Return the egg (backwards, up), unit-sized: full above, narrow at the lobe. `phase` is 0 behind and a quarter turn at the top."""
    across, up = np.cos(phase), np.sin(phase)
    egg = 1.0 + 0.16 * up - 0.10 * np.clip(-up, 0, 1) ** 2
    top = 1.0 + recipe.ears.point * np.clip(up, 0, 1) ** 6
    return np.stack([across * egg * np.where(across < 0, 0.82, 1.0), up * top], -1)


def base_pins(shape: Shape, k: int) -> Float[np.ndarray, "k 3"]:
    """Return the ear's base, an oval on the head in front of which the ear lifts off."""
    e = shape.recipe.ears
    oval = outline(shape.recipe, _phase(k)) * (0.40 * e.width / 2, 0.66 * e.height / 2) + (-0.10 * e.width, -0.03 * e.height)
    lean = np.radians(e.lean_deg)
    z = -np.cos(lean) * oval[:, 0] + -np.sin(lean) * oval[:, 1]
    y = np.cos(lean) * oval[:, 1] - np.sin(lean) * oval[:, 0]
    start = np.array(e.centre) + np.stack([0 * z, y, z], -1)
    return project(lambda p: skin_distance(shape, p), start, steps=8)


def _phase(k: int) -> Float[np.ndarray, " k"]:
    return 2 * np.pi * np.arange(k) / k


def ear_rings(recipe: Recipe, base: Float[np.ndarray, "k 3"], rings: int) -> Float[np.ndarray, "rings k 3"]:
    """Return the ear's rings from the innermost to the one next to its base."""
    e, k = recipe.ears, len(base)
    frame, shape = ear_frame(recipe), outline(recipe, _phase(k))
    centre = base.mean(0)
    table = np.array(PROFILE)
    places = np.linspace(0, len(table) - 1, rings)
    profile = np.stack([np.interp(places, np.arange(len(table)), column) for column in table.T], -1)
    out = np.empty((rings, k, 3))
    lift = 0.16 * e.width
    for i, (across, up, rise, shift) in enumerate(profile):
        flat = shape * (across * e.width / 2, up * e.height / 2) + ((0.30 - shift) * e.width / 2, 0.0)
        local = np.concatenate([flat, np.full((k, 1), rise * lift)], 1)
        ring = centre + local @ frame
        attach = np.clip(-shape[:, 0], 0, 1) ** 1.5 * (1 - 0.25 * i / rings) * (0.55 if rise < 1 else 0.35)
        out[i] = ring + attach[:, None] * np.clip((base - ring), -6, 6) * (1.0 if i < 5 else 0.5)
    return out[::-1]
