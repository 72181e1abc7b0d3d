"""Mouth actions: the lips' curves move along the face, and the skin around follows (layer 1).

An action says how seam and vermilion border move in wrapped coordinates (a across, b up, r out). The rings between are
blended, the mouth bag follows the seam, and `Sculptor.extend` carries the motion into the skin.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from data_recipes.deformers.sculpting import EXTENSION_MM2, Path, Sculptor
from data_recipes.head.shape import smoothstep

# What each mouth action does to the lips' curves, in wrapped coordinates.

Curve = Float[np.ndarray, " k"]
Motion = tuple[Curve, Curve, Curve]
SLACK_MM2 = 4.0
ROUND = 0.94  # from here on a lip moves with its corner, which is drawn out rounded and not to a point


@dataclass(frozen=True)
class LipAction:
    """How an action moves the lips.

    seam, border: (Δa, Δb, Δr) at full strength, from the place u along the lip and the side
    half: the part of each that is done half-way
    sided: whether it has a left and a right
    grows: whether a wider mouth moves further; sideways, no mouth has more slack than a person's
    both_ways: whether its control runs both ways, so that it draws out what it also draws in
    with_cheek: whether the cheek moves as much as the lips, and takes the mouth's lining along
    bending_mm2: of the skin around, for `Sculptor.extend`; where a lip turns about itself it must be slack, or the skin
        would go on turning down to the chin
    """

    seam: Callable[[Curve, Curve], Motion]
    border: Callable[[Curve, Curve], Motion]
    half: tuple[float, float, float] = (0.5, 0.5, 0.5)
    sided: bool = True
    grows: bool = True
    both_ways: bool = False
    with_cheek: bool = False
    bending_mm2: float = EXTENSION_MM2


def arch(u: Curve, power: float = 2.0) -> Curve:
    """Return 1 in the middle of the lip, falling to 0 in its corners; the higher the power, the later."""
    return 1 - np.abs(u) ** power


def corner(u: Curve, power: float) -> Curve:
    """Return 0 in the middle of the lip, rising to about 1 in its corners, and level beyond `ROUND`."""
    t = np.abs(u) / ROUND
    return (t / (1 + t**12) ** (1 / 12)) ** power


def _smile_seam(u: Curve, side: Curve) -> Motion:
    # The lips are closed and dip alike. Raising the upper lip bares the teeth, and so does a corrective with the jaw.
    up = 11.5 * corner(u, 2.2) - 1.2 * arch(u)
    # The corners go back too, around the teeth, as far as the contact lets them.
    return 10.0 * np.sign(u) * corner(u, 1.2), up, -4.5 * corner(u, 2.0) - 0.8 * arch(u)


def _smile_border(u: Curve, side: Curve) -> Motion:
    a, b, r = _smile_seam(u, side)
    return a, b - 0.8 * side * arch(u), r - 0.3 * arch(u)


def _frown(u: Curve, side: Curve) -> Motion:
    return 1.5 * np.sign(u) * corner(u, 2), -8.0 * corner(u, 2.0) + 1.0 * arch(u), -0.4 * corner(u, 1)


def _pucker_seam(u: Curve, side: Curve) -> Motion:
    return -12.8 * np.sign(u) * corner(u, 0.85), 0.5 * side * arch(u, 4), 8.0 * arch(u) + 3.0


def _pucker_border(u: Curve, side: Curve) -> Motion:
    # The lips' red swells: it has nowhere else to go.
    return -12.0 * np.sign(u) * corner(u, 0.9), 2.2 * side * arch(u, 3), 5.6 * arch(u) + 2.4


def _funnel_seam(u: Curve, side: Curve) -> Motion:
    return -7.5 * np.sign(u) * corner(u, 0.9), 4.8 * side * arch(u, 2.6), 7.5 * arch(u) + 2.0


def _funnel_border(u: Curve, side: Curve) -> Motion:
    return -6.5 * np.sign(u) * corner(u, 0.9), 4.4 * side * arch(u, 2.6), 4.5 * arch(u) + 1.5


def _raise_seam(u: Curve, side: Curve) -> Motion:
    # Highest over the canines, but no notch between: both sides together lift the whole lip.
    lift = (side > 0) * arch(u, 2.6) * (0.9 + 0.25 * np.exp(-(((np.abs(u) - 0.4) / 0.22) ** 2)))
    return 0.8 * np.sign(u) * lift * np.abs(u), 7.0 * lift + 1.2 * (side == 0), -1.6 * lift


def _raise_border(u: Curve, side: Curve) -> Motion:
    a, b, r = _raise_seam(u, side)
    return a, 0.84 * b, r + 1.4 * (b > 0) * arch(u, 4)


def _depress_seam(u: Curve, side: Curve) -> Motion:
    drop = (side < 0) * arch(u, 2.4) * (0.92 + 0.2 * np.exp(-(((np.abs(u) - 0.42) / 0.24) ** 2)))
    return 1.0 * np.sign(u) * drop * np.abs(u), -6.8 * drop - 1.0 * (side == 0), -1.8 * drop


def _depress_border(u: Curve, side: Curve) -> Motion:
    a, b, r = _depress_seam(u, side)
    return a, 0.78 * b, r + 1.6 * (b < 0) * arch(u, 4)


def _stretch_seam(u: Curve, side: Curve) -> Motion:
    return 11.0 * np.sign(u) * corner(u, 1.3), -4.2 * corner(u, 2) - 0.4, -4.4 * corner(u, 1.8) - 1.0


def _stretch_border(u: Curve, side: Curve) -> Motion:
    a, b, r = _stretch_seam(u, side)
    return a, b - 1.0 * side * arch(u), r


def _dimple(u: Curve, side: Curve) -> Motion:
    return 4.5 * np.sign(u) * corner(u, 3), 1.2 * corner(u, 3), -3.5 * corner(u, 4)


def _press_seam(u: Curve, side: Curve) -> Motion:
    return 0 * u, 0 * u, -1.2 * arch(u, 4)


def _press_border(u: Curve, side: Curve) -> Motion:
    return 0 * u, -2.4 * side * arch(u, 4), -0.5 * arch(u, 4)


def _chin_seam(u: Curve, side: Curve) -> Motion:
    lower = side < 0
    return 0 * u, 4.2 * arch(u, 1.8) - 1.0 * corner(u, 2), (1.2 + 1.0 * lower) * arch(u)


def _chin_border(u: Curve, side: Curve) -> Motion:
    # The lower lip is pushed up and out; it pouts.
    lower = side < 0
    return 0 * u, (3.4 + 1.6 * lower) * arch(u, 1.8) - 1.0 * corner(u, 2), (1.0 + 2.2 * lower) * arch(u)


def _roll_seam(lip: int) -> Callable[[Curve, Curve], Motion]:
    def seam(u: Curve, side: Curve) -> Motion:
        # The other lip comes along: it rests on this one, and no gap opens between.
        share = np.where(side == lip, 1.0, 0.55) * (side != 0)
        return 0 * u, lip * (0.2 * (side == lip) + 1.6 * (side == -lip)) * arch(u, 4), -4.2 * share * arch(u, 4)

    return seam


def _roll_border(lip: int) -> Callable[[Curve, Curve], Motion]:
    def border(u: Curve, side: Curve) -> Motion:
        mine, other = (side == lip) * arch(u, 4), (side == -lip) * arch(u, 4)
        return 0 * u, lip * (1.3 * other - 4.4 * mine), -1.8 * mine - 0.6 * other

    return border


def _sideways(u: Curve, side: Curve) -> Motion:
    return 8.5 * (1 - 0.12 * u * u), 0 * u, 0.3 * arch(u)


def _up(u: Curve, side: Curve) -> Motion:
    return 0 * u, 5.0 + 0 * u, 0.5 * arch(u)


ACTIONS = {
    "smile_*": LipAction(_smile_seam, _smile_border, (0.60, 0.40, 0.5), with_cheek=True),
    "frown_*": LipAction(_frown, _frown, (0.35, 0.55, 0.5)),
    "pucker_*": LipAction(_pucker_seam, _pucker_border, (0.52, 0.5, 0.42)),
    "funnel_*": LipAction(_funnel_seam, _funnel_border, (0.5, 0.42, 0.55)),
    "upper_lip_raise_*": LipAction(_raise_seam, _raise_border),
    "lower_lip_depress_*": LipAction(_depress_seam, _depress_border),
    "mouth_stretch_*": LipAction(_stretch_seam, _stretch_border),
    "dimple_*": LipAction(_dimple, _dimple, (0.6, 0.5, 0.35)),
    "lip_press_*": LipAction(_press_seam, _press_border),
    "chin_raise": LipAction(_chin_seam, _chin_border, (0.5, 0.45, 0.6), sided=False),
    "lip_roll_upper": LipAction(
        _roll_seam(1), _roll_border(1), (0.5, 0.55, 0.46), sided=False, both_ways=True, bending_mm2=SLACK_MM2
    ),
    "lip_roll_lower": LipAction(
        _roll_seam(-1), _roll_border(-1), (0.5, 0.55, 0.46), sided=False, both_ways=True, bending_mm2=SLACK_MM2
    ),
    "mouth_sideways": LipAction(_sideways, _sideways, sided=False, grows=False),
    "mouth_up_down": LipAction(_up, _up, sided=False),
}


BAG_SHARES = (1.0, 0.95, 0.85, 0.7, 0.5, 0.32, 0.18, 0.08)  # of the seam's motion, for the bag's rings
BACKWARDS = 0.2  # share of drawing in that is left deep in the bag, if the motion also runs backwards


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
    """Return (Δa, Δb, Δr) of every vertex, (n, 3): of lips, mouth bag, and the skin around.

    seam, border: the motion of these two curves
    bending_mm2: of the skin around (see `Sculptor.extend`)
    grows: whether it grows with the mouth's width and the recipe's `travel`
    both_ways: whether it is also run backwards
    with_cheek: whether the sides of the mouth's lining go with the cheek
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
    if with_cheek:  # lining that the seam doesn't take along goes with the cheek over it, or it would come through
        near, cover = sculptor.over_lining
        for j, share in enumerate(BAG_SHARES[: len(bag)]):
            change[bag[j]] += (1 - share) * cover[j][:, None] * change[near[j]].mean(axis=1)
    return change


def _apply_window(motion: Motion, window: Curve) -> Motion:
    return motion[0] * window, motion[1] * window, motion[2] * window


def sculpt(sculptor: Sculptor, action: LipAction) -> Path:
    """Return an action's path, on the left if it has sides; left and right add up to the whole mouth's."""
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
        weight = np.exp(-(((u - (1.0 if place == "left" else -1.0)) / 0.2) ** 2))
    else:
        on_lip = side == (1 if part == "upper" else -1)
        weight = on_lip * np.exp(-(((u - POINT_U[place]) / 0.22) ** 2)) * arch(u, 6)
    motion = tuple(POINT_TRAVEL_MM[axis] * weight if axis == other else 0 * u for other in "xyz")
    change = lip_change(sculptor, motion, _apply_window(motion, 0.65 * np.ones_like(u)))
    still = np.zeros(sculptor.n)
    return Path(sculptor.along_surface(0.5 * change), sculptor.along_surface(change), still, still)
