"""Actions of cheeks, nose, jaw, neck, ears and tongue (layer 1), sculpted with bumps along the skin."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from data_recipes.deformers.sculpting import Path, Sculptor
from data_recipes.head.shape import smoothstep


def sculpt(s: Sculptor) -> dict[str, Path]:
    """Return the actions by name; "*" stands for the left side."""
    return cheeks(s) | nose(s) | jaw_and_neck(s) | neck_tendon(s) | tongue(s)


def cheeks(s: Sculptor) -> dict[str, Path]:
    """Return the cheeks' actions, and what smile, squint and dimple do to the cheek."""
    lids, lips = fade(s, "eye"), fade(s, "mouth")
    apple = s.bump("cheek_left", 40.0) * lids * lips
    corner, cheek, jaw = s.point("mouth_corner_left"), s.point("cheek_left"), s.point("jaw_corner_left")
    hollow = s.nearest(0.55 * corner + 0.25 * cheek + 0.2 * jaw + np.array([6.0, 0, 0]))
    puff = s.bump(hollow, 46.0) * (0.35 + 0.65 * lips)
    upper_lip = s.bump("lip_upper_top", 24.0) * smoothstep(s.x[:, 0], -8, 8)
    mouth = s.head.recipe.mouth
    wide = max(1.0, mouth.half_width / 24.0 * mouth.travel[0])
    dent = s.bump(s.nearest(corner + wide * np.array([7.0, 2.0, -3.0])), 11.0 * wide)
    # The ring muscle of the eye gathers the skin beside it: crow's feet.
    beside = s.nearest(s.point("eye_outer_left") + np.array([9.0, -2, -10]))
    wing = s.point("nose_wing_left")
    fold = [s.nearest(wing + t * (corner - wing) + np.array([5.0, 2.0, -4.0])) for t in (0.1, 0.4, 0.7)]
    roll = [s.nearest(s.x[vertex] + np.array([6.0, 2.0, -2.0])) for vertex in fold]
    crease, beyond = s.bump(np.array(fold), 10.0) * lips, s.bump(np.array(roll), 17.0) * lips * lids
    gather = -0.3 * (s.bump(beside, 32.0) * (s.x[:, 1] - s.x[beside, 1]))[:, None] * s.up
    return {
        "cheek_raise_*": s.slide(apple[:, None] * (7.5 * s.up + 1.5 * s.out) + 0.5 * gather, 5.6 * apple),
        "cheek_puff_*": s.straight(np.zeros_like(s.x), 10.0 * puff + 1.5 * upper_lip * lips),
        # The lifted cheek is in the corner's way: it rolls over it, and stands out beside a fold from the nose's wing.
        "smile_*": s.slide(
            apple[:, None] * (3.2 * s.up + 0.6 * s.out) + 0.3 * gather,
            4.6 * apple + 1.6 * beyond - 1.6 * crease - 0.6 * dent,
        ),
        "squint_*": s.slide(gather),
        "dimple_*": s.straight(np.zeros_like(s.x), -2.4 * dent),
        "nasolabial_deepen_*": s.slide(beyond[:, None] * (2.4 * s.up - 1.0 * s.out), 2.4 * beyond - 2.8 * crease),
    }


def nose(s: Sculptor) -> dict[str, Path]:
    """Return the nose's actions, and what raising the upper lip does to its wings."""
    side = smoothstep(s.x[:, 0], -6, 6)
    lids = fade(s, "eye")
    wing = s.bump("nose_wing_left", 26.0) * side
    bridge_point = s.nearest(0.5 * (s.point("glabella") + s.point("nose_tip")) + np.array([7.0, 3.0, 0]))
    bridge = s.bump(bridge_point, 26.0) * side * lids
    lips = fade(s, "mouth")
    flank = s.bump(s.nearest(s.point("nose_wing_left") + np.array([7.0, 8, -6])), 24.0) * lids * lips
    # Where the wing meets the cheek, the raised lip and wing fold the skin.
    crease = s.bump(s.nearest(s.point("nose_wing_left") + np.array([5.0, 3.0, -5])), 11.0) * lips
    tip = s.bump("nose_tip", 30.0) * lips
    up = s.up
    return {
        "nose_wrinkle_*": s.slide(
            8.0 * (0.8 * wing * lips + 0.7 * flank)[:, None] * up + 5.0 * bridge[:, None] * up,
            3.0 * flank + 1.0 * bridge - 2.2 * crease,
        )
        + s.slide(-5.0 * (s.bump("brow_inner_left", 26.0) * side * lids)[:, None] * up),
        "nostril_flare_*": s.straight(np.array([3.2, 0.8, 0.2]) * (s.bump("nose_wing_left", 17.0) * side)[:, None]),
        "nose_up_down": s.straight(np.array([0, 3.6, 0.6]) * tip[:, None]),
        "nose_sideways": s.straight(np.array([4.0, 0, 0]) * tip[:, None]),
        "upper_lip_raise_*": s.slide(2.6 * (0.7 * wing * lips + flank)[:, None] * up, 1.4 * flank),
    }


def jaw_and_neck(s: Sculptor) -> dict[str, Path]:
    """Return the actions of chin, jaw and neck, and raising the ears."""
    lips = fade(s, "mouth")
    chin = s.bump("chin", 30.0) * lips
    jaw = s.bump(s.nearest(s.point("jaw_corner_left") + np.array([2.0, 9, 4])), 30.0)
    corner = s.point("jaw_corner_left")
    chin_point = s.point("chin")
    neck = s.nearest(np.array([0.45 * corner[0], chin_point[1] - 24, 0.5 * corner[2] + 12]))
    band = s.bump(neck, 34.0)
    jowl = s.bump(s.nearest(0.5 * (corner + chin_point) + np.array([4.0, -2, 4])), 34.0) * lips
    throat_low = s.nearest(np.array([0, chin_point[1] - 38, 40.0]))
    throat_high = s.nearest(np.array([0, chin_point[1] - 24, 40.0]))
    low, high = 3.4 * s.bump(throat_low, 16.0), 4.0 * s.bump(throat_high, 18.0)
    ear = s.in_parts("ear_left") | np.isin(np.arange(s.n), s.head.grids["ear_left"])
    base = s.head.grids["ear_left"][-1]
    lift = np.zeros(s.n)
    rings = s.head.grids["ear_left"]
    for j, ring in enumerate(rings):
        lift[ring] = smoothstep(np.array(1 - j / (len(rings) - 1)), 0.0, 0.4)
    inner = np.flatnonzero(ear & ~np.isin(np.arange(s.n), rings))
    lift[inner] = 1.0
    lift[base] = 0.0
    still = np.zeros(s.n)
    zero = np.zeros_like(s.x)
    return {
        "chin_raise": s.slide(6.0 * chin[:, None] * s.up, 1.6 * chin),
        "jaw_clench_*": s.straight(zero, 3.6 * jaw),
        "neck_tighten_*": s.slide(-5.0 * (0.7 * band + jowl)[:, None] * s.up + 2.0 * band[:, None] * s.out)
        + s.straight(zero, 3.0 * s.bump(neck, 20.0) - 1.0 * jowl),
        "throat_swallow": Path(zero, zero, low, high),
        "ear_raise_*": Path(
            lift[:, None] * np.array([0.6, 2.0, -0.6]), lift[:, None] * np.array([0.4, 4.0, -2.2]), still, still
        ),
    }


def neck_tendon(s: Sculptor) -> dict[str, Path]:
    """Return the action of the cord that stands out from behind the ear down to the pit of the throat."""
    top, low = s.point("chin")[1] + 12, s.x[:, 1].min()
    y = s.x[:, 1]
    neck = s.in_parts("neck", "face", "cranium") & (y < top)
    skull = s.head.recipe.skull
    axis = np.interp(y, [skull.neck_bottom[1], skull.neck_top[1]], [skull.neck_bottom[2], skull.neck_top[2]])
    angle = np.degrees(np.arctan2(s.x[:, 0], s.x[:, 2] - axis))
    away = angle - np.interp(y, [low, top], [32.0, 100.0])
    along = smoothstep(y, low + 4, low + 24) * smoothstep(y, top, top - 26) * neck
    ridge = np.exp(-((away / 11.0) ** 2)) - 0.35 * np.exp(-(((np.abs(away) - 24.0) / 13.0) ** 2))
    return {"neck_tendon_*": s.straight(np.zeros_like(s.x), 4.2 * ridge * along)}


def tongue(s: Sculptor) -> dict[str, Path]:
    """Return the tongue's actions, relative to the jaw, which carries it."""
    t = _along_tongue(s)
    inside = s.in_parts("tongue")
    t = np.where(inside, t, 0.0)
    middle = np.where(inside, s.x[:, 0], 0.0)
    height = np.where(inside, s.x[:, 1] - (s.x[inside, 1].mean() if inside.any() else 0.0), 0.0)
    scale = s.head.recipe.tongue.length / 42.0

    def move(x=0.0, y=0.0, z=0.0):
        return np.stack([x + 0 * t, y + 0 * t, z + 0 * t], axis=1) * scale

    # Less than half at half-way: so the parabola is flat on its negative side, where the floor of the mouth is.
    full_raise = move(y=10.0 * t**1.6, z=-1.5 * t**2)
    return {
        "tongue_raise": Path(move(y=4.1 * t**1.6, z=-0.5 * t**2), full_raise, 0 * t, 0 * t),
        "tongue_out": Path(move(z=4.0 * t, y=0.4 * t), move(z=7.0 * t, y=0.6 * t), 0 * t, 0 * t),
        "tongue_sideways": Path(move(x=4.0 * t**2), move(x=8.0 * t**2, z=-1.2 * t**2), 0 * t, 0 * t),
        "tongue_curl": Path(move(y=3.55 * t**3, z=-1.4 * t**3), move(y=8.5 * t**3, z=-4.0 * t**3), 0 * t, 0 * t),
        "tongue_wide": s.straight(move(x=0.22 * middle * t, y=-0.22 * height * t)),
        "tongue_twist": Path(
            move(x=-0.22 * height * t, y=0.22 * middle * t),
            move(x=-0.42 * height * t - 0.09 * middle * t, y=0.42 * middle * t - 0.09 * height * t),
            0 * t,
            0 * t,
        ),
    }


def tongue_reach(s: Sculptor) -> Float[np.ndarray, "n 3"]:
    """Return how much further the tongue comes out when the jaw is open: past the teeth."""
    t = _along_tongue(s)
    scale = s.head.recipe.tongue.length / 42.0
    return np.stack([0 * t, 7.0 * t - 4.0 * t**3, 26.0 * t], axis=1) * scale


def _along_tongue(s: Sculptor) -> Float[np.ndarray, " n"]:
    """Return how far along the tongue each vertex lies: 0 at its root and off it, 1 at its tip."""
    rings = s.head.grids["tongue"]
    t = np.zeros(s.n)
    for j, ring in enumerate(rings):
        t[ring] = j / max(len(rings) - 1, 1)
    t[s.head.grids["tongue_cap"]] = 1.0
    return t


def fade(s: Sculptor, part: str) -> Float[np.ndarray, " n"]:
    """Return 0 on the inner rings of the mouth or the eyes, rising to 1 at their outermost ring and beyond."""
    weight = np.ones(s.n)
    names = ("mouth",) if part == "mouth" else ("eye_left", "eye_right")
    for name in names:
        rings = s.head.grids[name]
        inner_rings = s.head.recipe.template.lip_rings if part == "mouth" else len(rings) // 4
        for j, ring in enumerate(rings[:-1]):
            weight[ring] = smoothstep(np.array(float(j)), inner_rings - 1, len(rings))
    for name in ("mouth_bag", "mouth_cap") if part == "mouth" else ("lid_inner_left", "lid_inner_right"):
        weight[s.head.grids[name]] = 0
    return weight
