"""Display-only things: eyeballs, brows, lashes, hair, horns and a bust.

They ride along in pictures and are no part of the approximated mesh.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from data_recipes.head.brows import brow
from data_recipes.head.bust import bust
from data_recipes.head.eyes import eyeball, lashes
from data_recipes.head.hair import hair
from data_recipes.head.prop_mesh import Prop, mirror_prop, on_skin, sheet
from data_recipes.head.shape import skull_distance, smoothstep
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
COLUMNS, ROWS = 17, 12
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
    t = np.linspace(0, 1, ROWS)[:, None]
    tangent = normal + 0.9 * t * tip_direction
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    step = length / (ROWS - 1)
    axis = foot - 0.35 * radius * normal + np.concatenate([np.zeros((1, 3)), np.cumsum(tangent[:-1] * step, 0)])
    side = np.cross(tangent, tip_direction + np.array([0, 0.01, 0]))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(tangent, side)
    around = np.linspace(0, 2 * np.pi, COLUMNS)[None, :, None]
    rings = 1 + 0.06 * np.cos(9 * np.pi * t) * (1 - t)
    thick = radius * rings * np.maximum(1 - t, 0.0) ** 0.85
    ring = np.cos(around) * side[:, None] + np.sin(around) * other[:, None]
    grid = axis[:, None] + thick[:, None] * ring
    dark = np.array(recipe.props.horn_colour)
    tip = dark + 0.35 * (np.array([0.80, 0.76, 0.68]) - dark)
    colours = dark + smoothstep(t, 0.25, 1.0)[:, None] * (tip - dark) + np.zeros((ROWS, COLUMNS, 1))
    return sheet(name, "skin", colours * (1 - 0.25 * (1 - rings[:, None] / 1.06)), grid)
