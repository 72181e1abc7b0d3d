"""Hair, for display only: a sheet of locks over the skull, from its hair line up to the crown.

A style is a hair line and how the hair lies. Where the hair line runs below the widest part of the head, the hair hangs
from there and does not follow jaw and neck.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter1d

from data_recipes.head.prop_mesh import FLIP, Prop, on_skin, sheet, smooth_step
from data_recipes.head.shape import skull_distance
from data_recipes.recipe.reading import Recipe

COLUMNS, ROWS, RAYS = 217, 40, 56
LOWEST_DEG = -62.0  # of the rays that find the skull, from the level of the temples
LOWEST_MM = -116.0  # of falling hair, on a cranium 74 mm high
HANG, RISE, ASIDE = 0.08, 0.38, 0.42  # falling hair draws in by at most this share of the way down, up and around


@dataclass(frozen=True)
class Style:
    """How hair is cut.

    line: height (mm, on a cranium 74 mm high) by angle around the head from the front. Angles from 80 to 120 are those
    of a head whose ears lie at 88°, and move with the ears. thick: over the crown, mm. locks: how many, and how deep,
    mm. fringe: how far their tips hang below the line, mm. falls: whether the hair hangs over the ears.
    """

    line: tuple[tuple[float, float], ...]
    thick: float
    locks: tuple[int, float]
    fringe: float = 0.0
    falls: bool = False


STYLES = {
    "cap": Style(
        (
            (0, 66), (16, 65), (32, 60), (45, 53), (55, 42), (62, 28), (68, 14), (74, 4), (78, 2), (82, 8), (88, 13),
            (96, 12), (104, -4), (112, -20), (124, -34), (150, -45), (180, -47),
        ), 8.0, (30, 1.0), 4.5,
    ),
    "short": Style(
        (
            (0, 74), (14, 73), (30, 69), (42, 66), (52, 54), (60, 36), (66, 16), (72, 4), (78, 2), (82, 8), (88, 15),
            (96, 14), (104, 0), (112, -14), (124, -24), (150, -31), (180, -33),
        ), 4.0, (44, 0.6), 0.8,
    ),
    "bob": Style(
        (
            (0, 79), (8, 77), (20, 73), (36, 66), (48, 57), (54, 48), (56, 38), (57.5, 0), (59, -70), (61, -96),
            (90, -100), (140, -102), (180, -102),
        ), 8.0, (26, 1.6), 0.0, True,
    ),
}  # fmt: skip


def hair(recipe: Recipe, x: Float[np.ndarray, "n 3"]) -> Prop:
    """Return the hair; `x` are the head's vertices, ears included."""
    style, s = STYLES[recipe.props.hair], recipe.skull
    scale, centre = s.cranium_radii[1] / 74.0, np.array(s.cranium) + np.array([0.0, -14.0, 2.0])
    turn = _columns(style)
    side = np.degrees(np.abs(turn))
    line = PchipInterpolator(*_line(style, recipe, centre).T)(side) * scale
    count, depth = style.locks
    front = 1 - smooth_step(side, 50, 66)
    uneven = 0.62 + 0.38 * np.sin(3.4 * turn + 0.9)  # no two tips of a fringe hang alike
    line = line - style.fringe * scale * front * uneven * np.abs(np.cos(0.42 * count * turn + 0.5 * np.sin(4 * turn)))
    p, normal = (_both_sides(half) for half in _scalp(recipe, style, turn[COLUMNS // 2 :], centre, x))
    low = _meet(p, line)
    share = np.concatenate([[0.0, 0.0], np.linspace(0.0, 1.0, ROWS - 2) ** 1.15])
    grid, outwards = _resample(p, low, share), _resample(normal, low, share)
    outwards /= np.maximum(np.linalg.norm(outwards, axis=-1, keepdims=True), 1e-9)
    share = share[:, None]
    sweep = count * turn + 2.6 * np.sin(2 * turn + 0.6) * share + 1.1 * np.sin(5 * turn + 0.4) + 0.6 * np.sin(11 * turn)
    lock = np.abs(np.cos(0.5 * sweep)) ** 0.7  # round backs, sharp partings
    fine = np.cos(3.7 * sweep + 4 * share)
    thick = style.thick * (0.22 + 0.78 * np.minimum(share / 0.22, 1) ** 0.65)
    thick = thick + (depth * lock + 0.2 * depth * fine) * np.minimum(share / 0.04, 1) * (1 - share) ** 0.6
    if style.falls:  # a parting in the middle, in front of the crown
        part = np.exp(-((side / 7.0) ** 2)) * (1 - smooth_step(share, 0.9, 1.0))
        thick = thick * (1 - 0.75 * part)
    thick[0] = -6.0 if style.falls else -1.0  # the edge is turned in, so that it looks thick
    grid = grid + scale * thick[..., None] * outwards
    base = np.array(recipe.props.hair_colour)
    light = 0.86 + 0.16 * lock + 0.06 * fine + 0.10 * np.cos(7 * turn + 1.0) * np.sin(np.pi * share)
    light = light + 0.22 * np.exp(-(((share - 0.56 - 0.05 * np.cos(9 * turn)) / 0.10) ** 2))  # a ring of gloss
    light = light * (0.84 + 0.16 * smooth_step(share, 0.0, 0.12))
    light[0] *= 0.7
    return sheet("hair", "hair" if style.falls else "skin", base * light[..., None], grid)


def _columns(style: Style) -> Float[np.ndarray, " columns"]:
    """Return the columns' angles, from the back over the right, the front and the left, dense where the line falls."""
    fine = np.linspace(0, 180, 2001)
    density = 1 + (5 * np.exp(-(((fine - 58) / 5) ** 2)) if style.falls else 0.8 * np.exp(-(((fine - 82) / 14) ** 2)))
    length = np.concatenate([[0], np.cumsum((density[1:] + density[:-1]) / 2)])
    half = np.radians(np.interp(np.linspace(0, length[-1], COLUMNS // 2 + 1), length, fine))
    return np.concatenate([-half[:0:-1], half])


def _line(style: Style, recipe: Recipe, centre: np.ndarray) -> Float[np.ndarray, "knots 2"]:
    """Return the style's hair line with its way around the ear moved to where the ears are."""
    line, e = np.array(style.line, float), recipe.ears
    if style.falls:
        return line
    scale = recipe.skull.cranium_radii[1] / 74.0
    aside = np.degrees(np.arctan2(e.centre[0], e.centre[2] - centre[2])) - 88.0
    top = (e.centre[1] + 0.30 * e.height) / scale - 13.4
    near = (line[:, 0] >= 80) & (line[:, 0] <= 120)
    line[near] += (aside, top)
    line[:, 0] = np.maximum.accumulate(line[:, 0] + 1e-3 * np.arange(len(line)))
    return line[line[:, 0] <= 180.1]


def _both_sides(left: Float[np.ndarray, "rays half 3"]) -> Float[np.ndarray, "rays columns 3"]:
    """Return the right half's columns, mirrored, before the left ones; the first of these lies in the middle."""
    return np.concatenate([left[:, :0:-1] * FLIP, left], 1)


def _scalp(recipe: Recipe, style: Style, turn, centre, x) -> tuple[np.ndarray, np.ndarray]:
    """Return where the left half of the hair lies and its normals, (rays, columns, 3), from below up to the crown."""
    pitch = np.radians(np.linspace(LOWEST_DEG, 90, RAYS))[:, None]
    scale = recipe.skull.cranium_radii[1] / 74.0
    towards = np.stack([np.cos(pitch) * np.sin(turn), np.sin(pitch) + 0 * turn, np.cos(pitch) * np.cos(turn)], -1)
    origin = centre + 0 * towards
    if style.falls:  # below the temples the rays are level, to meet the neck as well
        level = np.minimum(pitch / np.radians(-LOWEST_DEG), 0)
        origin[..., 1] += np.abs(level) * (LOWEST_MM * scale - centre[1])
        aside = np.stack([np.sin(turn), 0 * turn, np.cos(turn)], -1)
        towards = np.where((pitch < 0)[..., None], aside, towards)
    hits = on_skin(lambda q: skull_distance(recipe, q), origin.reshape(-1, 3), towards.reshape(-1, 3))
    p, normal = (values.reshape(towards.shape) for values in hits)
    if not style.falls:
        return p, normal
    reach = np.hypot(p[..., 0], p[..., 2] - centre[2])
    tent = _drape(np.maximum(reach, _ears_reach(p, turn, centre, x)), p[..., 1], turn)
    reach = reach + smooth_step(pitch, np.radians(62), np.radians(15)) * (tent - reach)
    reach = reach - 6.0 * scale * smooth_step(p[..., 1], 0.65 * LOWEST_MM * scale, 0.9 * LOWEST_MM * scale)
    p = np.stack([reach * aside[:, 0], p[..., 1], centre[2] + reach * aside[:, 2]], -1)
    hangs = smooth_step(pitch, np.radians(25), np.radians(-5))[..., None]
    return p, normal + hangs * (aside - normal)


def _drape(reach: np.ndarray, height: np.ndarray, turn: np.ndarray) -> Float[np.ndarray, "rays columns"]:
    """Drape hair over a shape and return how far out it lies: a tent over an ear, hanging below it."""
    step = np.diff(turn)
    for _ in range(2):
        for j in range(1, len(turn)):
            reach[:, j] = np.maximum(reach[:, j], reach[:, j - 1] * (1 - ASIDE * step[j - 1]))
        for j in range(len(turn) - 2, -1, -1):
            reach[:, j] = np.maximum(reach[:, j], reach[:, j + 1] * (1 - ASIDE * step[j]))
        for i in range(1, len(reach)):
            reach[i] = np.maximum(reach[i], reach[i - 1] - RISE * (height[i] - height[i - 1]).clip(0))
        for i in range(len(reach) - 2, -1, -1):
            reach[i] = np.maximum(reach[i], reach[i + 1] - HANG * (height[i + 1] - height[i]).clip(0))
    smooth = gaussian_filter1d(gaussian_filter1d(reach, 2.5, axis=1, mode="nearest"), 1.5, axis=0, mode="nearest")
    return np.maximum(smooth, reach - 1.0)


def _ears_reach(p, turn, centre, x) -> Float[np.ndarray, "rays columns"]:
    """Return how far from the axis the head's own vertices reach near each point: ears do, beyond the skull."""
    own = x - (0.0, 0.0, centre[2])
    far = np.hypot(own[:, 0], own[:, 2])
    angle = np.arctan2(own[:, 0], own[:, 2])
    reach = np.zeros(p.shape[:2])
    wide = np.flatnonzero((np.abs(np.sin(angle)) > 0.7) & (own[:, 1] > p[0, :, 1].min()))
    for column, t in enumerate(turn):
        if np.abs(np.sin(t)) < 0.7:
            continue
        close = wide[np.abs(np.angle(np.exp(1j * (angle[wide] - t)))) < np.radians(5)]
        for i, height in enumerate(p[:, column, 1]):
            near = close[np.abs(own[close, 1] - height) < 5]
            if len(near):
                reach[i, column] = far[near].max()
    return reach


def _meet(p: Float[np.ndarray, "rays columns 3"], line: Float[np.ndarray, " columns"]) -> Float[np.ndarray, " columns"]:
    """Return at which ray, in fractions, each column crosses the hair line for the last time on the way up."""
    place = np.empty(len(line))
    for column, height in enumerate(line):
        y = p[:, column, 1]
        below = np.flatnonzero(y[:-1] <= height)
        i = below[-1] if len(below) else 0
        place[column] = i + np.clip((height - y[i]) / max(y[i + 1] - y[i], 1e-6), 0, 1)
    return place


def _resample(values: Float[np.ndarray, "rays columns 3"], low, share) -> Float[np.ndarray, "rows columns 3"]:
    """Return values at shares of the way from the hair line (0) to the crown (1)."""
    place = low + (len(values) - 1 - low) * share[:, None]
    i = np.minimum(place.astype(int), len(values) - 2)
    f = (place - i)[..., None]
    column = np.arange(values.shape[1])
    return values[i, column] * (1 - f) + values[i + 1, column] * f
