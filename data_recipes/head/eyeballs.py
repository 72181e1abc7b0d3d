"""Eyeballs and lashes, for display only. Left eye; the right one is its mirror image."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from data_recipes.head.prop_mesh import Prop, sheet, smooth_step
from data_recipes.head.shape import rotation_y
from data_recipes.head.topology import Layout
from data_recipes.recipe.reading import Recipe

EYE_WHITE = np.array([0.93, 0.915, 0.895])
VEIN_COLOUR = np.array([0.86, 0.70, 0.66])  # the white away from the iris
PUPIL = np.array([0.02, 0.02, 0.025])
LASHES = (0.09, 0.06, 0.05)
SLIT = 0.30  # a slit pupil's width over its height
LIMBUS_DEG = 3.5  # width of the iris's dark rim
LONGEST_LASH_MM = {"short": 2.4, "long": 4.2}


def eyeball(recipe: Recipe) -> list[Prop]:
    """Return the left eye's white, iris, its dark rim and the pupil: zones of one sphere around the gaze."""
    e = recipe.eyes
    around = np.linspace(0, 2 * np.pi, 73)
    rim = e.iris_deg - LIMBUS_DEG
    parts = []
    for name, outer, inner, rows in (
        ("white", 180.0, e.iris_deg, 33),
        ("limbus", e.iris_deg, rim, 3),
        ("iris", rim, e.pupil_deg, 8),
        ("pupil", e.pupil_deg, 0.0, 5),
    ):
        degrees = np.linspace(outer, inner, rows)[:, None] + 0 * around
        angle = np.radians(degrees)
        slit = SLIT if e.pupil == "slit" else 1.0
        narrow = {"pupil": slit, "iris": np.linspace(1.0, slit, rows)[:, None]}.get(name, 1.0)
        sine = np.sin(angle)
        unit = np.stack([narrow * sine * np.cos(around), sine * np.sin(around), np.cos(angle)], -1)
        unit = unit / np.linalg.norm(unit, axis=-1, keepdims=True) @ rotation_y(e.gaze_yaw_deg)
        lift = 1.003 if name == "pupil" else 1.0
        colours = _colours(recipe, name, degrees, around) * _under_lid(recipe, unit)[..., None]
        parts.append(sheet(f"eye_{name}_left", "eye_left", colours, np.array(e.centre) + lift * e.radius * unit))
    return parts


def _colours(recipe: Recipe, zone: str, degrees, around) -> Float[np.ndarray, "rows columns 3"]:
    """Return a zone's colours by the angle from the gaze and around it; the iris is fibrous, brighter at the pupil."""
    e = recipe.eyes
    iris, flat = np.array(e.iris_colour), np.ones((*degrees.shape, 1))
    if zone == "white":
        far = smooth_step(degrees, e.iris_deg + 12, e.iris_deg + 42)[..., None]
        near = smooth_step(degrees, e.iris_deg + 4, e.iris_deg)[..., None]  # the white grows dull at the iris
        return (EYE_WHITE + 0.55 * far * (VEIN_COLOUR - EYE_WHITE)) * (1 - 0.14 * near)
    if zone == "pupil":
        return PUPIL * flat
    if zone == "limbus":
        outwards = smooth_step(degrees, e.iris_deg - LIMBUS_DEG, e.iris_deg - 0.4 * LIMBUS_DEG)[..., None]
        return iris * (0.62 - 0.40 * outwards)
    share = (degrees - e.pupil_deg) / (e.iris_deg - LIMBUS_DEG - e.pupil_deg)  # 0 at the pupil, 1 at the rim
    fibres = 0.10 * np.cos(24 * around) + 0.06 * np.cos(11 * around + 1.0)
    light = 1.22 - 0.55 * share**1.5 + fibres * np.sin(np.pi * share)
    light = light - 0.45 * smooth_step(share, 0.16, 0.0)
    return (iris * light[..., None] + 0.06 * smooth_step(share, 0.6, 0.2)[..., None]) * flat


def _under_lid(recipe: Recipe, unit: Float[np.ndarray, "rows columns 3"]) -> Float[np.ndarray, "rows columns"]:
    """Return how light the eyeball is by its place: darker where the upper lid shades it, and in the corners."""
    elevation = np.degrees(np.arcsin(np.clip(unit[..., 1], -1, 1)))
    azimuth = np.degrees(np.arctan2(unit[..., 0], unit[..., 2]))
    upper, aside = recipe.eyes.upper_deg, recipe.eyes.half_width_deg
    lid = smooth_step(elevation, 0.30 * upper, 1.05 * upper)
    return (1 - 0.42 * lid) * (1 - 0.18 * smooth_step(np.abs(azimuth), 0.55 * aside, 1.05 * aside))


def lashes(recipe: Recipe, layout: Layout, x: Float[np.ndarray, "n 3"]) -> Prop:
    """Return the left eye's upper lashes: a dark band that stands out from the rim, longest towards the temple."""
    rings = layout.grids["eye_left"]
    upper = np.arange(rings.shape[1] // 2 + 1)[::-1]  # from the nose to the temple
    rim, next_ring = x[rings[0, upper]], x[rings[1, upper]]
    t = np.linspace(0, 1, len(upper))
    out = rim - rim.mean(0)
    out = (out - out[:, 2:] * (0, 0, 1)) / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-9)
    long = (LONGEST_LASH_MM[recipe.props.lashes] * np.sin(np.pi * t**1.3) ** 0.6)[:, None]
    tip = rim + long * (0.75 * np.array([0, 0, 1.0]) + 0.45 * out + np.array([0.25, 0.2, 0]) * t[:, None])
    return sheet("lashes_left", "skin", LASHES, np.stack([rim, tip, 0.65 * rim + 0.35 * next_ring + (0, 0, 0.15)]))
