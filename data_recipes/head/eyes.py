"""Lids: the rim on the lid ball, and the inner lids behind it. Left eye; the right one is its mirror image."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from data_recipes.head.mouth import ring_parameter
from data_recipes.head.prop_mesh import Prop, sheet
from data_recipes.head.shape import eye_frame, lid_edge, rotation_y, smoothstep
from data_recipes.head.topology import Layout
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


# Eyeballs and lashes, for display only. Left eye; the right one is its mirror image.

EYE_WHITE = np.array([0.93, 0.915, 0.895])
VEIN_COLOUR = np.array([0.86, 0.70, 0.66])  # the white away from the iris
PUPIL = np.array([0.02, 0.02, 0.025])
LASHES = (0.09, 0.06, 0.05)
SLIT = 0.30  # a slit pupil's width over its height
LIMBUS_DEG = 3.5  # width of the iris's dark rim
LONGEST_LASH_MM = {"short": 2.4, "long": 4.2}


def eyeball(recipe: Recipe) -> list[Prop]:
    """Return the left eye's white, iris, its dark rim and the pupil: zones of a sphere around the gaze."""
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
        far = smoothstep(degrees, e.iris_deg + 12, e.iris_deg + 42)[..., None]
        near = smoothstep(degrees, e.iris_deg + 4, e.iris_deg)[..., None]  # the white grows dull at the iris
        return (EYE_WHITE + 0.55 * far * (VEIN_COLOUR - EYE_WHITE)) * (1 - 0.14 * near)
    if zone == "pupil":
        return PUPIL * flat
    if zone == "limbus":
        outwards = smoothstep(degrees, e.iris_deg - LIMBUS_DEG, e.iris_deg - 0.4 * LIMBUS_DEG)[..., None]
        return iris * (0.62 - 0.40 * outwards)
    share = (degrees - e.pupil_deg) / (e.iris_deg - LIMBUS_DEG - e.pupil_deg)  # 0 at the pupil, 1 at the rim
    fibres = 0.10 * np.cos(24 * around) + 0.06 * np.cos(11 * around + 1.0)
    light = 1.22 - 0.55 * share**1.5 + fibres * np.sin(np.pi * share)
    light = light - 0.45 * smoothstep(share, 0.16, 0.0)
    return (iris * light[..., None] + 0.06 * smoothstep(share, 0.6, 0.2)[..., None]) * flat


def _under_lid(recipe: Recipe, unit: Float[np.ndarray, "rows columns 3"]) -> Float[np.ndarray, "rows columns"]:
    """Return how light the eyeball is at each place: darker where the upper lid shades it, and in the corners."""
    elevation = np.degrees(np.arcsin(np.clip(unit[..., 1], -1, 1)))
    azimuth = np.degrees(np.arctan2(unit[..., 0], unit[..., 2]))
    upper, aside = recipe.eyes.upper_deg, recipe.eyes.half_width_deg
    lid = smoothstep(elevation, 0.30 * upper, 1.05 * upper)
    return (1 - 0.42 * lid) * (1 - 0.18 * smoothstep(np.abs(azimuth), 0.55 * aside, 1.05 * aside))


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
