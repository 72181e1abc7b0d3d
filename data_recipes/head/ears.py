"""Ears: an egg-shaped outline swept over the rim, into the fold behind it and down to the canal.

Left ear; the right one mirrors it.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from data_recipes.head.shape import Shape, distance_and_gradient, project, raycast, skin_distance
from data_recipes.recipe.reading import Recipe

# From behind the ear over its rim to the canal: size (share of the outline), height over the ear's plane (share of the
# relief), and how far the ring's middle moves towards the canal.
PROFILE = np.array(
    [
        (0.70, 0.00, 0.00),
        (0.92, 0.45, 0.00),  # behind the rim
        (1.00, 0.95, 0.00),  # outermost
        (0.99, 1.40, 0.00),
        (0.92, 1.58, 0.00),  # the rim's crest
        (0.84, 1.25, 0.02),
        (0.77, 0.66, 0.05),  # the groove inside the rim
        (0.64, 1.12, 0.12),  # the inner fold
        (0.53, 0.98, 0.22),
        (0.42, 0.12, 0.36),  # the bowl
        (0.26, -0.25, 0.52),
    ]
)
LOBE_HEIGHT = 1.0
CANAL = (-0.40, -0.16)  # where the bowl lies, in half widths backwards and half heights up


def ear_frame(recipe: Recipe) -> Float[np.ndarray, "3 3"]:
    """Return the left ear's axes as rows: backwards in its plane, up, and out of its plane."""
    lean, flare = np.radians(recipe.ears.lean_deg), np.radians(recipe.ears.flare_deg)
    back = np.array([np.sin(flare), 0.0, -np.cos(flare)])
    out = np.array([np.cos(flare), 0.0, np.sin(flare)])
    up = np.array([0.0, 1.0, 0.0])
    return np.stack([np.cos(lean) * back - np.sin(lean) * up, np.cos(lean) * up + np.sin(lean) * back, out])


def outline(phase: Float[np.ndarray, " k"], point: float) -> Float[np.ndarray, "k 2"]:
    """Return the egg (backwards, up), about unit-sized: full above, narrow at the lobe, flat in front.

    phase: 0 behind, a quarter turn on top. point: how far the top is drawn up into a point.
    """
    across, up = np.cos(phase), np.sin(phase)
    egg = 1.0 + 0.16 * up - 0.14 * np.clip(-up, 0, 1) ** 2
    top = 1.0 + point * np.clip(up, 0, 1) ** 6
    narrow = 1.0 - min(point, 0.6) * np.clip(up, 0, 1) ** 3
    return np.stack([across * egg * (0.80 + 0.20 * np.tanh(3 * across)) * narrow, up * top], -1)


def _phase(k: int) -> Float[np.ndarray, " k"]:
    return 2 * np.pi * np.arange(k) / k


def base_pins(shape: Shape, k: int) -> Float[np.ndarray, "k 3"]:
    """Return the ear's base, an oval on the head under the front half of the ear."""
    e = shape.recipe.ears
    oval = outline(_phase(k), 0.0) * (0.46 * e.width / 2, 0.64 * e.height / 2) + (
        -0.08 * e.width,
        -0.02 * e.height,
    )
    lean = np.radians(e.lean_deg)
    z = -np.cos(lean) * oval[:, 0] - np.sin(lean) * oval[:, 1]
    y = np.cos(lean) * oval[:, 1] - np.sin(lean) * oval[:, 0]
    start = np.array(e.centre) + np.stack([0 * z, y, z], -1)
    return project(lambda p: skin_distance(shape, p), start, steps=8)


def ear_rings(recipe: Recipe, base: Float[np.ndarray, "k 3"], rings: int) -> Float[np.ndarray, "rings k 3"]:
    """Return the ear's rings from the innermost to the one before its base."""
    e, k = recipe.ears, len(base)
    frame, phase = ear_frame(recipe), _phase(k)
    egg = outline(phase, e.point) * (e.width / 2, e.height / 2)
    front, low = np.clip(-np.cos(phase), 0, 1), np.clip((-np.sin(phase) - 0.45) / 0.5, 0, 1)
    relief = 0.17 * e.width
    strength = (1 - 0.55 * front**2) * (1 - 0.85 * low**1.5)  # the lobe is plain, the rim's root in front is low
    tragus = np.exp(-(((phase - np.pi * 1.04) / 0.30) ** 2))
    # The plane turns about its front edge, which stays on the head.
    hinge = 0.55 * e.width / 2 * np.sin(np.radians(e.flare_deg))
    centre = base.mean(0) + np.array([hinge - 0.08 * e.width, 0, 0])
    places = np.linspace(0, len(PROFILE) - 1, rings)
    out = []
    for place in places:
        size, height, shift = (np.interp(place, np.arange(len(PROFILE)), column) for column in PROFILE.T)
        flat = egg * size + np.array(CANAL) * shift * (e.width / 2, e.height / 2) + (0.14 * e.width, 0.0)
        inside = np.clip((place - 2) / 2, 0, 1)
        rise = height + inside * (1 - strength) * (LOBE_HEIGHT - height)
        near_tragus = tragus * np.exp(-(((place - 7.6) / 1.1) ** 2))
        rise = np.where(place > 8.2, np.minimum(rise, height), rise) + 0.75 * near_tragus
        flat[:, 0] += 0.10 * e.width * near_tragus
        rise = rise * (1 - 0.5 * front * np.clip((6 - place) / 3, 0, 1))  # in front the ear grows out of the cheek
        ring = centre + np.concatenate([flat, relief * rise[:, None]], 1) @ frame
        hold = np.clip(1 - place / 2.5, 0, 1) * (0.25 + 0.35 * front**2)
        out.append(ring + hold[:, None] * (base - ring))
    return np.stack(out[::-1])


# Nostrils: a pinned oval under the nose, two rings and a cap going in. Left nostril; the right one mirrors it.


def nostril_rim(recipe: Recipe) -> int:
    """Return which of a nostril's rings, from the inside, is its rim."""
    return max(recipe.template.nostril_rings - 1, 1) - 1


def _frame(shape: Shape) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the nostril's centre on the skin, its axes in the tangent plane (outwards, forwards), and the normal."""
    n = shape.recipe.nose
    along, tip = n.nostril_place[0], n.nostril_place[1]
    x, z = along * n.wing[0], tip * n.tip[2] + (1 - tip) * n.columella[2] + n.nostril_place[2]
    facing = np.array(n.nostril_facing) / np.linalg.norm(n.nostril_facing)
    before = np.array([[x, n.columella[1] - n.columella_radii[1], z]]) + 3.0 * facing
    centre = raycast(lambda p: skin_distance(shape, p), before - 60.0 * facing, facing[None], 60.0)
    normal = distance_and_gradient(lambda p: skin_distance(shape, p), centre, 1.0)[1][0]
    normal /= np.linalg.norm(normal)
    forward = np.array(n.nostril_long) - (np.array(n.nostril_long) @ normal) * normal
    forward /= np.linalg.norm(forward)
    return centre[0], np.stack([np.cross(forward, normal), forward]), normal


def nostril_rings(shape: Shape, k: int, rings: int) -> Float[np.ndarray, "rings k 3"]:
    """Return the nostril's rings from the innermost to the rim; those inside the rim narrow and rise into the nose."""
    centre, axes, normal = _frame(shape)
    wide, long, deep = shape.recipe.nose.nostril_axes
    phase = 2 * np.pi * np.arange(k) / k
    oval = (np.stack([np.cos(phase) * wide, np.sin(phase) * long], -1)) @ axes
    rim = project(lambda p: skin_distance(shape, p), centre + oval, steps=6)
    # A human nostril leads up more than straight in: seen from in front, it is dark.
    inwards = np.array(shape.recipe.nose.nostril_inwards) - 0.6 * normal
    inwards /= np.linalg.norm(inwards)
    out = [rim]
    for i in range(1, rings):
        share = i / (rings - 1)
        out.append(rim + (centre - rim) * (0.3 + 0.2 * share) + inwards * deep * share**0.8)
    return np.stack(out[::-1])
