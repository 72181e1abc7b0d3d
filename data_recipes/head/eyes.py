"""Lids: the rim on the lid ball, and the inner lids behind it. Left eye; the right one is its mirror image."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from data_recipes.head.mouth import ring_parameter
from data_recipes.head.shape import eye_frame, lid_edge
from data_recipes.recipe.reading import Recipe


def rim_angles(recipe: Recipe, k: int) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Return azimuth and elevation (radians) of the rim's ring, spaced evenly along the rim."""
    fine = np.linspace(1, -1, 801)
    half = k // 2
    azimuth, elevation = np.empty(k), np.empty(k)
    for upper, places in ((True, np.arange(half + 1)), (False, np.arange(half, k + 1))):
        a, e = fine * np.radians(recipe.eyes.half_width_deg), lid_edge(recipe, fine, upper)
        length = np.concatenate([[0], np.cumsum(np.hypot(np.diff(a), np.diff(e)))])
        s = np.linspace(0, length[-1], half + 1)
        s = s if upper else s[::-1]
        azimuth[places % k] = np.interp(s, length, a)
        elevation[places % k] = np.interp(s, length, e)
    return azimuth, elevation


def on_ball(
    recipe: Recipe,
    azimuth: Float[np.ndarray, " k"],
    elevation: Float[np.ndarray, " k"],
    radius: Float[np.ndarray, " k"],
) -> Float[np.ndarray, "k 3"]:
    """Return points of the left eye at angles (radians) and distances (mm) from its centre."""
    q = np.stack([np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)], -1)
    return np.array(recipe.eyes.centre) + (np.asarray(radius)[..., None] * q) @ eye_frame(recipe)


def rim_pins(recipe: Recipe, k: int) -> Float[np.ndarray, "k 3"]:
    """Return the rim's ring, just inside the lid's outer face."""
    azimuth, elevation = rim_angles(recipe, k)
    u, _ = ring_parameter(k)
    height = recipe.eyes.lid_thickness * (0.9 - 0.4 * u**8)  # lids grow thin towards the corners
    return on_ball(recipe, azimuth, elevation, recipe.eyes.radius + height)


def inner_lids(recipe: Recipe, k: int, rings: int) -> Float[np.ndarray, "rings k 3"]:
    """Return the inner lid's rings: over the margin to the eyeball, then behind the lid."""
    e = recipe.eyes
    azimuth, elevation = rim_angles(recipe, k)
    growth = np.interp(np.linspace(0, 1, rings) if rings > 1 else [0.0], [0, 1 / 3, 2 / 3, 1], [0.0, 0.10, 0.28, 0.50])
    scale = e.radius / 20.5
    out = np.empty((rings, k, 3))
    size = np.hypot(azimuth, elevation)
    for i, g in enumerate(growth):
        factor = 1 + g / size
        out[i] = on_ball(
            recipe, azimuth * factor, elevation * factor, np.full(k, e.radius + scale * (0.5 if i == 0 else 0.35))
        )
    return out
