"""Mouth actions: the lips' curves move along the face, and the skin around follows (layer 1).

An action says how seam and vermilion border move in wrapped coordinates (see `lip_motions`). The rings between are
blended, the mouth bag follows the seam, and the skin is `extend`ed.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from data_recipes.deformers.lip_motions import ACTIONS, Curve, LipAction, Motion, arch
from data_recipes.deformers.sculpting import EXTENSION_MM2, Path, Sculptor, smoothstep

__all__ = ["ACTIONS", "BAG_SHARES", "lip_change", "sculpt", "sculpt_point"]
BAG_SHARES = (1.0, 0.95, 0.85, 0.7, 0.5, 0.32, 0.18, 0.08)
BACKWARDS = 0.2  # of what is drawn in deep in the bag, that a motion may take that run backwards would draw out


# Places of the lip-curve points along u.
POINT_U = {"01": -0.72, "02": -0.38, "03": 0.0, "04": 0.38, "05": 0.72}
POINT_TRAVEL_MM = {"x": 4.0, "y": 4.0, "z": 3.5}


def lip_change(
    sculptor: Sculptor,
    seam: Motion,
    border: Motion,
    bending_mm2: float = EXTENSION_MM2,
    grows: bool = True,
    both_ways: bool = False,
    with_cheek: bool = False,
) -> Float[np.ndarray, "n 3"]:
    """Return (Δa, Δb, Δr) of every vertex for a motion of seam and border: lips, mouth bag, and the skin around.

    grows: with the mouth's width, as the recipe's `travel` says. both_ways: the motion is run backwards, too.
    with_cheek: the sides of the mouth's lining go with the cheek.
    """
    head = sculptor.head
    mouth, bag = head.grids["mouth"], head.grids["mouth_bag"]
    lip_rings = head.recipe.template.lip_rings
    inner, outer = np.stack(seam, axis=1), np.stack(border, axis=1)
    change = np.zeros((sculptor.n, 3))
    for j in range(lip_rings + 1):
        t = j / lip_rings
        change[mouth[j]] = (1 - t) * inner + t * outer
    size = head.recipe.mouth.half_width / 24.0 * np.array(head.recipe.mouth.travel) if grows else np.ones(3)
    change = sculptor.extend(change * size, bending_mm2)
    for j, share in enumerate(BAG_SHARES[: len(bag)]):
        change[bag[j]] = share * inner * size
    # Deep in the bag, rings stand much higher than the seam: they must not be drawn out with it.
    deep = bag[min(3, len(bag) - 1) : len(BAG_SHARES)]
    change[deep, 2] = np.minimum(change[deep, 2], 0.0) * (BACKWARDS if both_ways else 1.0)
    if with_cheek:  # what the seam does not take along goes with the cheek over it, or it would come out through it
        near, cover = sculptor.over_lining
        for j, share in enumerate(BAG_SHARES[: len(bag)]):
            change[bag[j]] += (1 - share) * cover[j][:, None] * change[near[j]].mean(axis=1)
    return change


def _apply_window(motion: Motion, window: Curve) -> Motion:
    return motion[0] * window, motion[1] * window, motion[2] * window


def sculpt(sculptor: Sculptor, action: LipAction) -> Path:
    """Return an action's path, of the left side if it has sides; left and right together give the whole mouth's."""
    u, side = sculptor.head.ring_parameter["mouth_u"], sculptor.head.ring_parameter["mouth_side"]
    window = smoothstep(u, -0.45, 0.45) if action.sided else np.ones_like(u)
    seam, border = (_apply_window(motion(u, side), window) for motion in (action.seam, action.border))
    change = lip_change(sculptor, seam, border, action.bending_mm2, action.grows, action.both_ways, action.with_cheek)
    half, full = sculptor.along_surface(change * np.array(action.half)), sculptor.along_surface(change)
    still = np.zeros(sculptor.n)
    return Path(half, full, still, still)


def sculpt_point(sculptor: Sculptor, name: str) -> Path:
    """Return the path of one axis of a lip-curve point, such as "lip_upper_03_y" or "lip_corner_left_x"."""
    u, side = sculptor.head.ring_parameter["mouth_u"], sculptor.head.ring_parameter["mouth_side"]
    _, part, place, axis = name.split("_")
    if part == "corner":
        centre, mine, width = (1.0 if place == "left" else -1.0), np.ones_like(u), 0.2
    else:
        centre, mine, width = POINT_U[place], (side == (1 if part == "upper" else -1)).astype(float), 0.22
    weight = mine * np.exp(-(((u - centre) / width) ** 2))
    if part != "corner":
        weight = weight * arch(u, 6)
    direction = [POINT_TRAVEL_MM[axis] * weight if axis == name_ else 0 * u for name_ in "xyz"]
    change = lip_change(sculptor, tuple(direction), _apply_window(tuple(direction), 0.65 * np.ones_like(u)))
    still = np.zeros(sculptor.n)
    return Path(sculptor.along_surface(0.5 * change), sculptor.along_surface(change), still, still)
