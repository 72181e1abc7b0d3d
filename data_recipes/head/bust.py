"""What a head stands on in pictures, for display only: the collar and shoulders of a shirt, or a creature's neck.

Without it a head ends in a cut. Cameras don't make room for it: the lower edge of the picture cuts it off.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from data_recipes.head.head_paint import bare_skin
from data_recipes.head.prop_mesh import Prop, sheet
from data_recipes.head.shape import (
    Distances,
    Points,
    cone,
    ellipsoid,
    raycast,
    smooth_max,
    smooth_min,
    smoothstep,
    soft_abs,
)
from data_recipes.recipe.reading import Recipe

COLUMNS, ROWS, RAYS = 121, 56, 240
SHOULDERS = 3.5  # half the shoulders' width over the neck's radius
# Along the shirt from its edge: place (mm) and height over the body (mm): turned in, the band, its seam, the cloth.
BAND = np.array([(0.0, -5.0), (0.1, 1.2), (1.2, 2.4), (4.5, 2.7), (7.8, 2.4), (9.0, 0.9), (10.5, 1.2), (14.0, 1.3)])


def bust(recipe: Recipe) -> Prop:
    """Return the bust that the recipe names."""
    return {"shirt": _shirt, "neck": _neck}[recipe.props.bust](recipe)


def _foot(recipe: Recipe) -> tuple[Float[np.ndarray, " 3"], float]:
    """Return the middle (mm) and the radius of the neck where the head's mesh ends."""
    s, height = recipe.skull, recipe.template.anchors[0][1]
    top, bottom = np.array(s.neck_top), np.array(s.neck_bottom)
    t = (height - top[1]) / (bottom[1] - top[1])
    return top + t * (bottom - top), s.neck_radii[0] + t * (s.neck_radii[1] - s.neck_radii[0])


def _body(recipe: Recipe, p: Points) -> Distances:
    """Return the distance to neck and shoulders, closed below as a sculptor's bust is."""
    s, (foot, r) = recipe.skull, _foot(recipe)
    far = np.stack([soft_abs(p[:, 0], 36.0), p[:, 1], p[:, 2]], -1)
    wide = SHOULDERS * r
    d = cone(p, s.neck_top, s.neck_bottom, s.neck_radii[0] + 0.5, s.neck_radii[1] + 0.5)
    tip = foot + np.array([wide - 0.85 * r, -1.05 * r, -0.15 * r])
    root = foot + np.array([0.2 * r, -0.72 * r, -0.1 * r])
    d = smooth_min(d, cone(far, root, tip, 0.75 * r, 0.85 * r), 0.75 * r)
    chest = foot + np.array([0.0, -2.9 * r, 0.05 * r])
    d = smooth_min(d, ellipsoid(p, chest, (0.80 * wide, 2.7 * r, 1.55 * r)), 1.0 * r)
    return smooth_max(d, foot[1] - 3.4 * r - p[:, 1], 0.8 * r)


def _shirt(recipe: Recipe) -> Prop:
    """Return a shirt with a round neckline, which hides where the neck ends."""
    foot, r = _foot(recipe)
    turn = np.linspace(-np.pi, np.pi, COLUMNS)
    ahead = (1 + np.cos(turn)) / 2
    edge = foot[1] + 0.14 * r + 0.32 * r * (1 - ahead) ** 1.5
    origin = foot - (0, 1.6 * r, 0)
    first = np.arctan2(edge - origin[1], 1.03 * r + 1.0)
    pitch = first + np.linspace(0, 1, RAYS)[:, None] * (np.radians(-80) - first)
    towards = np.stack([np.cos(pitch) * np.sin(turn), np.sin(pitch), np.cos(pitch) * np.cos(turn)], -1)
    flat = towards.reshape(-1, 3)
    p = raycast(lambda q: _body(recipe, q), origin + 0 * flat, flat, 9 * r, 120).reshape(towards.shape)
    length = np.concatenate([np.zeros((1, COLUMNS)), np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=-1), 0)])
    beyond = np.linspace(0, 1, ROWS - len(BAND) + 1)[1:] ** 1.3
    rows = np.empty((ROWS, COLUMNS, 3))
    for k in range(COLUMNS):
        places = np.concatenate([BAND[:, 0], BAND[-1, 0] + beyond * (length[-1, k] - BAND[-1, 0])])
        rows[:, k] = np.stack([np.interp(places, length[:, k], p[:, k, i]) for i in range(3)], -1)
    outwards = np.cross(np.gradient(rows, axis=1), -np.gradient(rows, axis=0))
    outwards[:, [0, -1]] = outwards[:, [0]] + outwards[:, [-1]]
    outwards /= np.maximum(np.linalg.norm(outwards, axis=-1, keepdims=True), 1e-9)
    outwards[: len(BAND) - 2] = towards[0] * (1, 0, 1) / np.linalg.norm(towards[0] * (1, 0, 1), axis=-1, keepdims=True)
    far = np.concatenate([np.zeros(len(BAND)), beyond])[:, None]
    folds = 0.035 * r * np.cos(5 * turn + 9 * far) * np.sin(np.pi * np.minimum(far / 0.5, 1)) ** 2
    height = np.concatenate([BAND[:, 1], np.full(ROWS - len(BAND), BAND[-1, 1])])[:, None] + folds
    grid = rows + height[..., None] * outwards
    band = np.isin(np.arange(ROWS), [1, 2, 3, 4])[:, None]
    seam = (np.arange(ROWS) == 5)[:, None]
    light = np.where(band, 0.90, 1.0) * np.where(seam, 0.80, 1.0) * np.ones(COLUMNS)
    light[0] = 0.6
    colour = np.array(recipe.props.shirt_colour) * light[..., None]
    return sheet("bust", "skin", colour[::-1], grid[::-1])


def _neck(recipe: Recipe) -> Prop:
    """Return a neck that goes on below the mesh, thicker and thicker, in the colours of the skin."""
    s, (foot, r) = recipe.skull, _foot(recipe)
    top, bottom = np.array(s.neck_top), np.array(s.neck_bottom)
    low, wide = top + 4 * (bottom - top), s.neck_radii[0] + 4 * (s.neck_radii[1] - s.neck_radii[0])
    turn = np.linspace(-np.pi, np.pi, COLUMNS)
    down = np.linspace(-4.0, 4.2 * r, ROWS)[:, None, None]
    around = np.stack([np.sin(turn), 0 * turn, np.cos(turn)], -1) + 0 * down
    axis = foot + down * (bottom - top) / (top - bottom)[1] + 0 * around
    flat = axis.reshape(-1, 3), around.reshape(-1, 3)
    p = raycast(lambda q: cone(q, top, low, s.neck_radii[0], wide), *flat, 4 * r, 100).reshape(axis.shape)
    flare = 0.10 * r * (np.maximum(down, 0) / r) ** 2 - 0.5 * smoothstep(down, 0.0, -4.0)
    grid = p + flare * around
    colour = bare_skin(recipe, grid.reshape(-1, 3)).reshape(grid.shape)
    return sheet("bust", "skin", colour[::-1], grid[::-1])
