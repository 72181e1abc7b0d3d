"""Display-only things: eyeballs, brows, lashes, hair, horns and a bust.

They ride along in pictures and are no part of the approximated mesh.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from data_recipes.head.bust import bust
from data_recipes.head.eyes import eyeball, lashes
from data_recipes.head.hair import hair
from data_recipes.head.hair_locks import NARROW, Paths, Scalp, ribbons
from data_recipes.head.prop_mesh import Prop, join, mirror_prop, on_skin, sheet
from data_recipes.head.shape import lidded_distance, skull_distance, smoothstep
from data_recipes.head.topology import Layout
from data_recipes.recipe.reading import Recipe

__all__ = ["Prop", "build_props"]


def build_props(recipe: Recipe, layout: Layout, x: Float[np.ndarray, "n 3"]) -> tuple[Prop, ...]:
    """Return a head's props; `x` are the head's vertices."""
    styles, left = recipe.props, eyeball(recipe)
    if styles.brows != "none":
        left.append(brow(recipe))
    if styles.lashes != "none":
        left.append(lashes(recipe, layout, x))
    props = [side for prop in left for side in (prop, mirror_prop(prop))]
    if styles.hair != "none":
        props.append(hair(recipe, x))
    if styles.horns != "none":
        props += horns(recipe)
    if styles.bust != "none":
        props.append(bust(recipe))
    return tuple(props)


# Horns, for display only: a row of curved cones over brow and crown, in pairs, with a crest between them.

# Around the head from the front (deg), up from the level of the ears (deg), length and radius at the skin (mm, on a
# cranium 74 mm high). Pairs; those at 180° stand on the midline alone.
PAIRS = ((30.0, 40.0, 11.0, 4.2), (42.0, 60.0, 16.0, 5.0), (88.0, 62.0, 38.0, 7.5), (128.0, 38.0, 28.0, 6.5))
CREST = ((180.0, 82.0, 13.0, 4.5), (180.0, 62.0, 15.0, 5.0), (180.0, 40.0, 13.0, 4.5), (180.0, 18.0, 10.0, 4.0))
HORN_COLUMNS, HORN_ROWS = 41, 11
TIP_DIRECTION = np.array([0.0, 0.25, -1.0])  # where the tips point


def horns(recipe: Recipe) -> list[Prop]:
    """Return every horn, `horn_left_1` and so on from the brow to the nape, then the crest."""
    parts = []
    for number, place in enumerate(PAIRS, 1):
        left = _horn(recipe, f"horn_left_{number}", *place)
        parts += [left, mirror_prop(left)]
    return parts + [_horn(recipe, f"horn_crest_{number}", *place) for number, place in enumerate(CREST, 1)]


def _horn(recipe: Recipe, name: str, turn_deg: float, pitch_deg: float, length: float, radius: float) -> Prop:
    s = recipe.skull
    scale = s.cranium_radii[1] / 74.0
    length, radius = scale * length * recipe.props.horn_length, scale * radius
    turn, pitch = np.radians(turn_deg), np.radians(pitch_deg)
    towards = np.array([[np.cos(pitch) * np.sin(turn), np.sin(pitch), np.cos(pitch) * np.cos(turn)]])
    if turn_deg == 180:
        towards[0, 0] = 0.0
    foot, normal = on_skin(lambda q: skull_distance(recipe, q), np.array([s.cranium]) + 0 * towards, towards)
    foot, normal = foot[0], normal[0]
    if turn_deg == 180:
        foot[0] = normal[0] = 0.0
        normal /= np.linalg.norm(normal)
    tip_direction = TIP_DIRECTION / np.linalg.norm(TIP_DIRECTION)
    t = np.linspace(0, 1, HORN_ROWS)[:, None]
    tangent = normal + 0.9 * t * tip_direction
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    step = length / (HORN_ROWS - 1)
    axis = foot - 0.35 * radius * normal + np.concatenate([np.zeros((1, 3)), np.cumsum(tangent[:-1] * step, 0)])
    side = np.cross(tangent, tip_direction + np.array([0, 0.01, 0]))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(tangent, side)
    around = np.linspace(0, 2 * np.pi, HORN_COLUMNS)[None, :, None]
    rings = 1 + 0.06 * np.cos(9 * np.pi * t) * (1 - t)
    thick = radius * rings * np.maximum(1 - t, 0.0) ** 0.85
    ring = np.cos(around) * side[:, None] + np.sin(around) * other[:, None]
    grid = axis[:, None] + thick[:, None] * ring
    dark = np.array(recipe.props.horn_colour)
    tip = dark + 0.35 * (np.array([0.80, 0.76, 0.68]) - dark)
    colours = dark + smoothstep(t, 0.25, 1.0)[:, None] * (tip - dark) + np.zeros((HORN_ROWS, HORN_COLUMNS, 1))
    return sheet(name, "skin", colours * (1 - 0.25 * (1 - rings[:, None] / 1.06)), grid)


# Brows, for display only: hairs on a soft shade over the brow ridge, neutral at rest. Left one; the right mirrors it.
#
# Both ends lie at one height, or a face at rest looks sad or cross; the arch peaks at two thirds of the way outwards.


# Half the height (mm), how far the arch rises (share of the ridge's radius), how far it stands out (mm).
STYLES = {"natural": (2.9, 0.52, 1.0), "thin": (1.6, 0.66, 0.7), "thick": (4.4, 0.42, 1.5)}
BROW_COLUMNS, BROW_ROWS = 41, 11
SEED = 6  # of the hairs' irregularities


def brow(recipe: Recipe) -> Prop:
    """Return the left brow: it begins softly near the nose, is fullest at a third and ends in a point."""
    s = recipe.skull
    half_mm, arch, stands = STYLES[recipe.props.brows]
    t, across = np.linspace(0, 1, BROW_COLUMNS), np.linspace(-1, 1, BROW_ROWS)
    inner, outer = np.array(s.brow_inner), np.array(s.brow_outer)
    line = inner + (outer - inner) * (0.06 + 1.04 * t)[:, None]
    level = inner[1] + 0.35 * (outer[1] - inner[1]) + 0 * t  # the ridge may slope; the brow does by a third of it
    level = level + (0.3 * (outer[1] - inner[1]) - 0.3 * s.brow_radii[0]) * (t - 0.5)
    peak = np.sin(np.pi * t ** (np.log(0.5) / np.log(0.58)))
    rise = s.brow_radii[0] * (0.45 + arch * peak)
    half = half_mm * (0.62 + 0.38 * smoothstep(t, 0.0, 0.3)) * (1 - smoothstep(t, 0.5, 1.02)) ** 0.9 + 0.2
    half = half * np.minimum(1, t / 0.05 + 0.35) ** 0.5
    middle = level + rise
    flat = np.stack([np.broadcast_to(line[:, 0], (BROW_ROWS, BROW_COLUMNS)), middle + across[:, None] * half], -1)
    flat[..., 0] += 0.35 * across[:, None] * half  # hairs lean outwards
    origin = np.concatenate([flat, np.zeros((BROW_ROWS, BROW_COLUMNS, 1))], -1).reshape(-1, 3)
    straight = np.array([0.0, 0, 1.0]) + 0 * origin
    origin[:, 0] *= 0.5  # the rays fan out, so that they meet the temple at a fair angle
    straight[:, 0] = origin[:, 0] / np.repeat(line[None, :, 2], BROW_ROWS, 0).ravel()
    straight /= np.linalg.norm(straight, axis=1, keepdims=True)
    p, normal = on_skin(lambda q: lidded_distance(recipe, q), origin, straight)
    ends = smoothstep(t, 0.0, 0.10) * smoothstep(t, 1.0, 0.94)
    height = stands * (1 - across[:, None] ** 2) ** 0.8 * (0.55 + 0.45 * half / half.max())
    height = 0.45 * height * (0.15 + 0.85 * ends) - 0.1
    grid = (p + height.reshape(-1, 1) * normal).reshape(BROW_ROWS, BROW_COLUMNS, 3)
    colour, skin = 0.66 * np.array(recipe.props.hair_colour), np.array(recipe.props.skin_colour)
    soft = np.maximum(smoothstep(np.abs(across), 0.40, 1.0)[:, None], smoothstep(t, 0.14, 0.0))[..., None]
    shade = sheet("brow_left", "skin", colour + (0.15 + 0.85 * soft) * (skin - colour), grid)
    ridge = Scalp(t, p.reshape(grid.shape), normal.reshape(grid.shape))
    return join("brow_left", "skin", [shade, *_hairs(ridge, half_mm, colour)])


def _hairs(ridge: Scalp, half_mm: float, colour: np.ndarray) -> list[Prop]:
    """Return hairs from a brow's lower edge: upright near the nose, then combed outwards, crossing those from above."""
    generator, parts, s = np.random.default_rng(SEED), [], np.linspace(0, 1, 8)
    for count, first, last, lift_mm in ((48, -0.90, 0.45, 0.15), (40, 0.80, -0.05, 0.3)):
        start = np.linspace(0.0, 0.93, count) + generator.uniform(-0.015, 0.015, count)
        lean = 0.04 + 0.14 * smoothstep(start, 0.0, 0.35) + generator.uniform(-0.015, 0.015, count)
        lean = np.minimum(lean, 1.0 - start)
        begin, end = (place + generator.uniform(-0.15, 0.15, count) for place in (first, last))
        turn = start[:, None] + lean[:, None] * s
        across = np.clip(begin[:, None] + (end - begin)[:, None] * s**0.8, -1, 1)
        wide = (0.20 + 0.11 * half_mm) * generator.uniform(0.8, 1.2, count)
        paths = Paths(turn, (across + 1) / 2 * (BROW_ROWS - 1), wide, np.full(count, lift_mm), np.full(count, NARROW))
        parts += ribbons(ridge, paths, 0.3 + 0 * turn, tuple(colour), 1.0, 2.0, generator, 5)
    return parts
