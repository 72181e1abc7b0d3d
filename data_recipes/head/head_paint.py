"""Paint: a colour for each vertex of a head, for display only, from its grids and its neutral shape.

First the skin, then blush, lids and lips, each blended in by a weight from 0 to 1, then the parts inside. Weights come
from rings and distances, so the paint is as symmetric as the head.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, UInt8

from data_recipes.head.ears import nostril_rim
from data_recipes.head.mouth import ring_parameter
from data_recipes.head.shape import lid_angles, smoothstep
from data_recipes.head.topology import (
    BAG,
    CRANIUM,
    EAR_LEFT,
    EAR_RIGHT,
    FACE,
    GUM_LOWER,
    GUM_UPPER,
    LID_LEFT,
    LID_RIGHT,
    TONGUE,
    Layout,
)
from data_recipes.recipe.reading import Recipe

GUM = np.array([0.78, 0.42, 0.42])
TONGUE_ROOT, TONGUE_TIP = np.array([0.62, 0.26, 0.28]), np.array([0.84, 0.44, 0.45])
BAG_DEEP = np.array([0.27, 0.07, 0.08])
IVORY, IVORY_ROOT = np.array([0.96, 0.94, 0.89]), np.array([0.90, 0.84, 0.70])
WATERLINE = np.array([0.80, 0.52, 0.49])  # the rim between lid and eyeball
NOSTRIL = np.array([0.20, 0.08, 0.07])


def paint(recipe: Recipe, layout: Layout, x: Float[np.ndarray, "n 3"]) -> UInt8[np.ndarray, "n 3"]:
    """Return each vertex's colour; `x` are the head's vertices in its neutral pose, mm."""
    props = recipe.props
    colour = bare_skin(recipe, x)

    def over(weight, tint) -> None:
        colour[:] = _blend(colour, weight, tint)

    over(props.blush * _blush(recipe, layout, x), props.blush_colour)
    over(props.lid * _lids(recipe, layout, x), props.lid_colour)
    over(_nostrils(recipe, layout), NOSTRIL * (0.4 + 0.6 * np.array(props.skin_colour)))
    lips = props.lip * _lips(recipe, layout)
    over(lips, props.lip_colour)
    _inside(recipe, layout, colour, lips)
    return np.rint(255 * np.clip(colour, 0, 1)).astype(np.uint8)


def bare_skin(recipe: Recipe, x: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Return the colour of the bare skin, from 0 to 1, at any place; back and throat differ."""
    props = recipe.props
    colour = np.tile(np.array(props.skin_colour), (len(x), 1))
    colour = _blend(colour, props.back * _back(recipe, x), props.back_colour)
    return _blend(colour, props.throat * _throat(recipe, x), props.throat_colour)


def _blend(colour: np.ndarray, weight: np.ndarray, tint) -> np.ndarray:
    return colour + np.clip(weight, 0, 1)[:, None] * (np.asarray(tint) - colour)


def _near(x: np.ndarray, place, radius: float) -> np.ndarray:
    """Return 1 at a place on the left side and at its mirror image, falling off as a Gaussian of |x|."""
    left = np.stack([np.abs(x[:, 0]), x[:, 1], x[:, 2]], -1)
    return np.exp(-(((left - np.asarray(place)) / radius) ** 2).sum(-1))


def _scale(recipe: Recipe) -> float:
    return recipe.skull.cranium_radii[0] / 75.0


def _blush(recipe: Recipe, layout: Layout, x: np.ndarray) -> np.ndarray:
    s, n, scale = recipe.skull, recipe.nose, _scale(recipe)
    bone = np.array(s.cheekbone) + np.array([-1.0, -7.0, 0.7 * s.cheekbone_radii[2]])
    weight = _near(x, bone, 20 * scale) + 0.75 * _near(x, (0, n.tip[1], n.tip[2] + n.tip_radius), 14 * scale)
    weight += 0.35 * _near(x, (0, s.chin[1], s.chin[2] + s.chin_radii[2]), 16 * scale)
    ear = np.isin(layout.part, (EAR_LEFT, EAR_RIGHT))
    rings = len(layout.grids["ear_left"])
    for side in ("left", "right"):
        ids = layout.grids[f"ear_{side}"]
        deep = np.linspace(1.0, 0.0, rings)[:, None]  # 1 in the canal, 0 where the ear joins the head
        weight[ids] = np.maximum(weight[ids], smoothstep(deep, 0.05, 0.45) * (0.55 + 0.9 * smoothstep(deep, 0.6, 1)))
        weight[layout.grids[f"ear_cap_{side}"]] = 1.6
    return weight * (ear | np.isin(layout.part, (FACE, CRANIUM)))


def _lids(recipe: Recipe, layout: Layout, x: np.ndarray) -> np.ndarray:
    """Return how much lid colour there is: on the upper lid up to its crease, the rims, and faintly under the eye."""
    e = recipe.eyes
    left = np.stack([np.abs(x[:, 0]), x[:, 1], x[:, 2]], -1)
    azimuth, elevation, r = lid_angles(recipe, left)
    u = azimuth / np.radians(e.half_width_deg)
    skin = np.isin(layout.part, (FACE, LID_LEFT, LID_RIGHT)) & (left[:, 2] > e.centre[2])
    reach = np.exp(-(((r - e.radius - 2.0) / 9.0) ** 2)) * np.exp(-(np.abs(u) ** 4)) * skin
    degrees = np.degrees(elevation)
    upper = np.exp(-(((degrees - e.upper_deg - 6) / 13.0) ** 2))
    under = 0.45 * np.exp(-(((degrees + e.lower_deg + 12) / 12.0) ** 2))
    weight = np.maximum(upper, under) * reach
    for side in ("left", "right"):
        rings = layout.grids[f"eye_{side}"]
        for ring, share in ((0, 1.0), (1, 0.8), (2, 0.4)):
            if ring < len(rings) - 1:
                weight[rings[ring]] = np.maximum(weight[rings[ring]], share)
    return weight


def _lips(recipe: Recipe, layout: Layout) -> np.ndarray:
    """Return how much lip colour there is: full within the vermilion border, half on it, none outside."""
    t, rings, bag = recipe.template, layout.grids["mouth"], layout.grids["mouth_bag"]
    weight = np.zeros(len(layout.part))
    u, _ = ring_parameter(rings.shape[1])
    corner = 1 - 0.5 * np.abs(u) ** 12  # the border fades where upper and lower lip meet
    weight[rings[: t.lip_rings]] = 1.0
    weight[rings[t.lip_rings]] = 0.5 * corner
    weight[bag[:2]] = 1.0
    return weight


def _nostrils(recipe: Recipe, layout: Layout) -> np.ndarray:
    """Return how dark the nostrils are: inside fully, on the rim a little; any more would look sooty."""
    weight = np.zeros(len(layout.part))
    rim = nostril_rim(recipe)
    for side in ("left", "right"):
        rings = layout.grids[f"nostril_{side}"]
        weight[rings[:rim]] = 1.0
        weight[rings[rim]] = 0.35 if rim else 1.0
        cap = layout.grids[f"nostril_cap_{side}"]
        weight[np.setdiff1d(cap, rings)] = 1.0
    return weight


def _back(recipe: Recipe, x: np.ndarray) -> np.ndarray:
    """Return 1 on crown, nape and the ridge of the snout, 0 on the sides' lower half."""
    s, scale = recipe.skull, _scale(recipe)
    crown = smoothstep(x[:, 1], s.cranium[1] - 25 * scale, s.cranium[1] + 50 * scale)
    nape = smoothstep(x[:, 2], -10 * scale, -70 * scale)
    ridge = np.exp(-((x[:, 0] / (16 * scale)) ** 2)) * smoothstep(x[:, 1], -15 * scale, 20 * scale)
    return np.maximum(np.maximum(crown, nape), ridge)


def _throat(recipe: Recipe, x: np.ndarray) -> np.ndarray:
    """Return 1 on throat, chin and lower jaw, 0 above the mouth; on the neck only in front."""
    m, scale = recipe.mouth, _scale(recipe)
    low = smoothstep(x[:, 1], m.y + 6 * scale, m.y - 22 * scale)
    snout = 0.6 * smoothstep(x[:, 2], 55 * scale, 100 * scale) * smoothstep(x[:, 1], 15 * scale, -20 * scale)
    return np.maximum(low * smoothstep(x[:, 2], -30 * scale, 25 * scale), snout)


def _inside(recipe: Recipe, layout: Layout, colour: np.ndarray, lips: np.ndarray) -> None:
    """Paint what isn't skin: inner lids, mouth bag, gums, tongue and teeth."""
    grids, part = layout.grids, layout.part
    for side in ("left", "right"):
        for ring, ids in enumerate(grids[f"lid_inner_{side}"]):
            colour[ids] = WATERLINE * (1 - 0.12 * ring)
    bag = grids["mouth_bag"]
    deep = np.array(colour[bag[0]])
    colour[part == BAG] = BAG_DEEP
    for ring, ids in enumerate(bag):
        share = smoothstep(ring, 0, min(5, len(bag) - 1))
        wet = lips[ids].max() if ring < 2 else 0.0
        colour[ids] = (deep * (0.9 if wet else 0.75)) * (1 - share) + BAG_DEEP * share
    colour[np.isin(part, (GUM_UPPER, GUM_LOWER))] = GUM
    tongue = grids["tongue"]
    share = np.linspace(0, 1, len(tongue))[:, None, None]
    colour[part == TONGUE] = TONGUE_TIP
    colour[tongue] = TONGUE_ROOT + share * (TONGUE_TIP - TONGUE_ROOT)
    t, teeth = recipe.teeth, grids["teeth"]
    if t.style == "strip":  # rows run from the outside over the edge inwards
        to_edge = 1 - np.abs(np.linspace(-1, 1, t.ring))
        to_edge = np.repeat(to_edge, teeth.shape[1] // t.ring)
    else:  # ring by ring from the root to the edge
        to_edge = np.repeat(np.linspace(0, 1, t.rings), t.ring)
    colour[teeth] = IVORY_ROOT + smoothstep(to_edge, 0.1, 0.6)[:, None] * (IVORY - IVORY_ROOT)
