"""Nostrils: a pinned oval under the nose, two rings and a cap going in. Left nostril; the right one mirrors it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from data_recipes.head.sdf import distance_and_gradient, project, raycast
from data_recipes.head.shape import Shape, skin_distance
from data_recipes.recipe.reading import Recipe


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
