"""Mouth actions: the lips' curves move along the face, and the skin around follows (layer 1).

An action says how seam and vermilion border move in wrapped coordinates (Δa across, Δb up, Δr out, in mm for a lip of
half-width 26 mm) as functions of u, the place along the lip (−1 right corner … +1 left corner), and of the side (+1
upper lip, −1 lower, 0 corner). The rings between are blended, the mouth bag follows the seam, the skin is `extend`ed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from data_recipes.deformers.sculpting import Path, Sculptor, smoothstep

Curve = Float[np.ndarray, " k"]
Motion = tuple[Curve, Curve, Curve]  # Δa, Δb, Δr along the ring
BAG_SHARES = (1.0, 0.95, 0.85, 0.7, 0.5, 0.32, 0.18, 0.08)


@dataclass(frozen=True)
class LipAction:
    """How an action moves the lips at full strength, and which part of (Δa, Δb, Δr) it has done half-way."""

    seam: Callable[[Curve, Curve], Motion]
    border: Callable[[Curve, Curve], Motion]
    half: tuple[float, float, float] = (0.5, 0.5, 0.5)
    sided: bool = True


def _arch(u: Curve, power: float = 2.0) -> Curve:
    return 1 - np.abs(u) ** power


def _corner(u: Curve, power: float) -> Curve:
    return np.abs(u) ** power


def _smile_seam(u: Curve, side: Curve) -> Motion:
    up = 12.0 * _corner(u, 2.0) + np.where(side < 0, -2.0, -0.6) * _arch(u)
    return 8.5 * np.sign(u) * _corner(u, 1.3), up, -3.2 * _corner(u, 1.5) - 2.0 * _arch(u)


def _smile_border(u: Curve, side: Curve) -> Motion:
    a, b, r = _smile_seam(u, side)
    return a, b - 1.3 * side * _arch(u), r


def _frown(u: Curve, side: Curve) -> Motion:
    return 1.5 * np.sign(u) * _corner(u, 2), -8.0 * _corner(u, 2.0) + 1.0 * _arch(u), -0.6 * _corner(u, 1)


def _pucker_seam(u: Curve, side: Curve) -> Motion:
    return -12.5 * np.sign(u) * _corner(u, 0.9), 0 * u, 7.0 * _arch(u) + 1.5


def _pucker_border(u: Curve, side: Curve) -> Motion:
    return -11.5 * np.sign(u) * _corner(u, 0.9), 1.0 * side * _arch(u), 4.5 * _arch(u) + 1.5


def _funnel_seam(u: Curve, side: Curve) -> Motion:
    return -7.0 * np.sign(u) * _corner(u, 0.9), 4.8 * side * _arch(u, 2.6), 7.5 * _arch(u) + 2.0


def _funnel_border(u: Curve, side: Curve) -> Motion:
    return -6.5 * np.sign(u) * _corner(u, 0.9), 4.2 * side * _arch(u, 2.4), 4.5 * _arch(u) + 1.5


def _raise_seam(u: Curve, side: Curve) -> Motion:
    lift = (side > 0) * np.exp(-(((np.abs(u) - 0.36) / 0.42) ** 2)) * _arch(u, 4)
    return 0.8 * np.sign(u) * lift, 6.8 * lift + 1.2 * (side == 0), -2.6 * lift


def _raise_border(u: Curve, side: Curve) -> Motion:
    a, b, r = _raise_seam(u, side)
    return a, 0.92 * b, r + 1.2 * (b > 0) * _arch(u, 4)


def _depress_seam(u: Curve, side: Curve) -> Motion:
    drop = (side < 0) * np.exp(-(((np.abs(u) - 0.30) / 0.48) ** 2)) * _arch(u, 4)
    return 1.0 * np.sign(u) * drop, -7.2 * drop - 1.0 * (side == 0), -2.8 * drop


def _depress_border(u: Curve, side: Curve) -> Motion:
    a, b, r = _depress_seam(u, side)
    return a, 0.85 * b, r + 1.4 * (b < 0) * _arch(u, 4)


def _stretch_seam(u: Curve, side: Curve) -> Motion:
    return 10.0 * np.sign(u) * _corner(u, 1.3), -3.0 * _corner(u, 2) - 0.5, -3.0 * _corner(u, 1.2) - 2.0


def _stretch_border(u: Curve, side: Curve) -> Motion:
    a, b, r = _stretch_seam(u, side)
    return a, b - 1.3 * side * _arch(u), r


def _dimple(u: Curve, side: Curve) -> Motion:
    return 4.5 * np.sign(u) * _corner(u, 3), 1.2 * _corner(u, 3), -4.5 * _corner(u, 4)


def _press_seam(u: Curve, side: Curve) -> Motion:
    return 0 * u, 0 * u, -1.6 * _arch(u, 4)


def _press_border(u: Curve, side: Curve) -> Motion:
    return 0 * u, -2.7 * side * _arch(u, 4), -0.9 * _arch(u, 4)


def _chin_seam(u: Curve, side: Curve) -> Motion:
    return 0 * u, 4.2 * _arch(u, 1.8) - 1.0 * _corner(u, 2), 1.4 * _arch(u)


def _chin_border(u: Curve, side: Curve) -> Motion:
    lower = side < 0
    return 0 * u, (3.0 + 2.6 * lower) * _arch(u, 1.8) - 1.0 * _corner(u, 2), (1.0 + 1.8 * lower) * _arch(u)


def _roll_seam(which: int) -> Callable[[Curve, Curve], Motion]:
    def seam(u: Curve, side: Curve) -> Motion:
        mine = (side == which) * _arch(u, 4)
        return 0 * u, 0.6 * which * mine, -4.6 * mine

    return seam


def _roll_border(which: int) -> Callable[[Curve, Curve], Motion]:
    def border(u: Curve, side: Curve) -> Motion:
        mine = (side == which) * _arch(u, 4)
        return 0 * u, -4.0 * which * mine, -2.0 * mine

    return border


def _sideways(u: Curve, side: Curve) -> Motion:
    return 8.5 * (1 - 0.12 * u * u), 0 * u, 0.3 * _arch(u)


def _up(u: Curve, side: Curve) -> Motion:
    return 0 * u, 5.0 + 0 * u, 0.5 * _arch(u)


ACTIONS = {
    "smile_*": LipAction(_smile_seam, _smile_border, (0.60, 0.40, 0.5)),
    "frown_*": LipAction(_frown, _frown, (0.35, 0.55, 0.5)),
    "pucker_*": LipAction(_pucker_seam, _pucker_border, (0.52, 0.5, 0.4)),
    "funnel_*": LipAction(_funnel_seam, _funnel_border, (0.5, 0.42, 0.55)),
    "upper_lip_raise_*": LipAction(_raise_seam, _raise_border),
    "lower_lip_depress_*": LipAction(_depress_seam, _depress_border),
    "mouth_stretch_*": LipAction(_stretch_seam, _stretch_border),
    "dimple_*": LipAction(_dimple, _dimple, (0.6, 0.5, 0.35)),
    "lip_press_*": LipAction(_press_seam, _press_border),
    "chin_raise": LipAction(_chin_seam, _chin_border, (0.5, 0.45, 0.6), sided=False),
    "lip_roll_upper": LipAction(_roll_seam(1), _roll_border(1), (0.5, 0.62, 0.42), sided=False),
    "lip_roll_lower": LipAction(_roll_seam(-1), _roll_border(-1), (0.5, 0.62, 0.42), sided=False),
    "mouth_sideways": LipAction(_sideways, _sideways, sided=False),
    "mouth_up_down": LipAction(_up, _up, sided=False),
}

# Places of the lip-curve points along u.
POINT_U = {"01": -0.72, "02": -0.38, "03": 0.0, "04": 0.38, "05": 0.72}
POINT_TRAVEL_MM = {"x": 4.0, "y": 4.0, "z": 3.5}


def lip_change(sculptor: Sculptor, seam: Motion, border: Motion) -> Float[np.ndarray, "n 3"]:
    """Return (Δa, Δb, Δr) of every vertex for a motion of seam and border: lips, mouth bag, and the skin around."""
    head = sculptor.head
    mouth, bag = head.grids["mouth"], head.grids["mouth_bag"]
    lip_rings = head.recipe.template.lip_rings
    inner, outer = np.stack(seam, axis=1), np.stack(border, axis=1)
    change = np.zeros((sculptor.n, 3))
    for j in range(lip_rings + 1):
        t = j / lip_rings
        change[mouth[j]] = (1 - t) * inner + t * outer
    size = head.recipe.mouth.half_width / 24.0
    change = sculptor.extend(change * size)
    for j, share in enumerate(BAG_SHARES[: len(bag)]):
        change[bag[j]] = share * inner * size
    # Deep in the bag, rings stand much higher than the seam: they must not be drawn out with it.
    deep = bag[min(3, len(bag) - 1) : len(BAG_SHARES)]
    change[deep, 2] = np.minimum(change[deep, 2], 0.0)
    return change


def _windowed(motion: Motion, window: Curve) -> Motion:
    return motion[0] * window, motion[1] * window, motion[2] * window


def sculpt(sculptor: Sculptor, action: LipAction) -> Path:
    """Return an action's path, of the left side if it has sides; left and right together give the whole mouth's."""
    u, side = sculptor.head.ring_parameter["mouth_u"], sculptor.head.ring_parameter["mouth_side"]
    window = smoothstep(u, -0.45, 0.45) if action.sided else np.ones_like(u)
    change = lip_change(sculptor, _windowed(action.seam(u, side), window), _windowed(action.border(u, side), window))
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
        weight = weight * _arch(u, 6)
    direction = [POINT_TRAVEL_MM[axis] * weight if axis == name_ else 0 * u for name_ in "xyz"]
    change = lip_change(sculptor, tuple(direction), _windowed(tuple(direction), 0.65 * np.ones_like(u)))
    still = np.zeros(sculptor.n)
    return Path(sculptor.along_surface(0.5 * change), sculptor.along_surface(change), still, still)
