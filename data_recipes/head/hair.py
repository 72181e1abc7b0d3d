"""Hair, for display only: a thin sheet from the hair line up to the crown, and locks that lie on it.

A style is a hair line and how the hair lies. At its edge the sheet thins out, dips into the skin and takes on its
colour, and thin strands hang over it, so that the hair grows out of the head instead of sitting on it. Where the hair
line is lower than the widest part of the head, the hair hangs down from there and doesn't follow jaw and neck.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter1d

from data_recipes.head.hair_locks import RAYS, Layer, Paths, Scalp, build_scalp, combed, falling, head_centre, ribbons
from data_recipes.head.prop_mesh import Prop, join, sheet
from data_recipes.head.shape import smoothstep
from data_recipes.recipe.reading import Recipe

COLUMNS, ROWS = 217, 40
FRINGE_MM = 2.2  # how far locks stand off the forehead, which rises and wrinkles under them
STRANDS, STRANDS_FRINGE, STRANDS_DEG = Layer(150, 0.16, -0.03, 1.9, 0.0), 0.05, 80.0  # over the line, up to this angle
SEED = 5  # of the locks' irregularities, the same for every head


@dataclass(frozen=True)
class Style:
    """How hair is cut.

    line: (angle around the head from the front, height in mm on a cranium 74 mm high); from 80 to 120° it moves with
        the ears, which are taken to be at 88°
    thick: of the sheet over the crown, mm
    layers: of locks, from the hair line upwards
    fringe: how far the front locks hang below the line, as a share of the way to the crown
    part_deg, sweep_deg: where they part, and how far they are swept aside
    falls: whether the hair hangs over the ears
    """

    line: tuple[tuple[float, float], ...]
    thick: float
    layers: tuple[Layer, ...] = ()
    fringe: float = 0.0
    part_deg: float = 0.0
    sweep_deg: float = 0.0
    falls: bool = False


STYLES = {
    "cap": Style(
        (
            (0, 68), (16, 67), (32, 62), (45, 54), (55, 43), (62, 29), (68, 14), (74, 4), (78, 2), (82, 8), (88, 13),
            (96, 12), (104, -4), (112, -20), (124, -34), (150, -45), (180, -47),
        ),
        5.0,
        (
            Layer(44, 0.40, -0.02, 7.5, 1.2),
            Layer(38, 0.66, 0.10, 8.0, 2.2),
            Layer(30, 0.88, 0.32, 8.0, 3.2),
            Layer(20, 0.99, 0.58, 7.0, 3.6),
        ),
        fringe=0.16, part_deg=-32.0, sweep_deg=30.0,
    ),
    "short": Style(
        (
            (0, 74), (14, 73), (30, 69), (42, 66), (52, 54), (60, 36), (66, 16), (72, 4), (78, 2), (82, 8), (88, 15),
            (96, 14), (104, 0), (112, -14), (124, -24), (150, -31), (180, -33),
        ),
        3.0,
        (
            Layer(64, 0.32, 0.0, 5.4, 0.6),
            Layer(52, 0.52, 0.16, 5.5, 1.2),
            Layer(42, 0.76, 0.36, 6.0, 2.0),
            Layer(26, 0.98, 0.58, 6.0, 2.6),
        ),
        fringe=0.03, part_deg=-48.0, sweep_deg=26.0,
    ),
    "bob": Style(
        (
            (0, 79), (8, 77), (20, 73), (36, 66), (48, 57), (54, 48), (56, 38), (57.5, 0), (59, -70), (61, -96),
            (90, -100), (140, -102), (180, -102),
        ),
        8.5, part_deg=-12.0, falls=True,
    ),
}  # fmt: skip


def hair(recipe: Recipe, x: Float[np.ndarray, "n 3"]) -> Prop:
    """Return the hair; `x` are the head's vertices, ears included."""
    style, generator = STYLES[recipe.props.hair], np.random.default_rng(SEED)
    scale, centre = recipe.skull.cranium_radii[1] / 74.0, head_centre(recipe)
    scalp = build_scalp(recipe, _half_columns(style), style.falls, x)
    side = np.degrees(np.abs(scalp.turn))
    line = PchipInterpolator(*_line(style, recipe, centre).T)(side) * scale
    if not style.falls:  # no two strands begin at one height
        line = line + scale * gaussian_filter1d(generator.normal(0, 2.2, len(line)), 1.6, mode="wrap")
    low = scalp.ray_at(line)
    if style.falls:
        layers, blunt = falling(scalp, low, style.part_deg, generator), 7.0
    else:
        front = (style.fringe, style.part_deg, style.sweep_deg)
        layers, blunt = [combed(layer, scalp, low, *front, generator) for layer in style.layers], 2.4
        layers.append(_first_strands(style, scalp, low))
    parts = [_sheet(style, recipe, scalp, low, scale, generator)]
    for paths in layers:
        around = np.mod(paths.turn + np.pi, 2 * np.pi) - np.pi
        below = np.interp(around, scalp.turn, low)
        share = (paths.ray - below) / (RAYS - 1 - below)
        base = _thickness(style, np.degrees(np.abs(around)), share)
        above_face = smoothstep(np.abs(around), 1.3, 0.9) * smoothstep(share, 0.25, 0.05)
        base = gaussian_filter1d(np.maximum(base, FRINGE_MM * above_face), 1.5, axis=1, mode="nearest")
        if style.falls:  # locks rise from the parting; the sheet's valley is wider, so that it stays under them
            base = base * (1 - 0.5 * _parting(style, around, share, 9.0))
        parts += ribbons(scalp, paths, base, recipe.props.hair_colour, scale, blunt, generator)
    return join("hair", "hair" if style.falls else "skin", parts)


def _first_strands(style: Style, scalp: Scalp, low) -> Paths:
    """Return thin strands over the forehead's and temples' hair line, under which the sheet's edge is out of sight."""
    generator = np.random.default_rng(SEED + 1)
    strands = combed(STRANDS, scalp, low, STRANDS_FRINGE, style.part_deg, 0.5 * style.sweep_deg, generator)
    in_front = np.abs(strands.turn[:, -1]) < np.radians(STRANDS_DEG)
    return Paths(*(getattr(strands, field.name)[in_front] for field in fields(strands)))


def _thickness(style: Style, side, share) -> np.ndarray:
    """Return how thick the sheet is (mm), given the angle from the front (deg) and the share of the way up."""
    hangs = _hangs(style, side)
    edge = 0.05 + 0.25 * hangs
    thick = style.thick * (edge + (1 - edge) * smoothstep(share / (0.45 - 0.2 * hangs), 0.0, 1.0))
    thick = thick * (1 + 0.6 * hangs * np.exp(-(((share - 0.62) / 0.16) ** 2)))  # over the temples it stands out
    return np.where(share < 0, 0.0, thick + smoothstep(share, 0.0, 0.07))


def _parting(style: Style, turn, share, width_deg: float) -> np.ndarray:
    """Return 1 at the parting, in front of the crown, and 0 aside, given the angle (rad) and the share of the way up.

    width_deg: how far aside it has fallen to 1/e
    """
    return np.exp(-(((np.degrees(turn) - style.part_deg) / width_deg) ** 2)) * smoothstep(share, 0.85, 0.55)


def _hangs(style: Style, side) -> np.ndarray:
    """Return 1 where the edge hangs free, 0 where hair grows out of the skin, given the angle from the front (deg)."""
    return smoothstep(side, 51, 56) if style.falls else 0 * side


def _sheet(style: Style, recipe: Recipe, scalp: Scalp, low, scale: float, generator: np.random.Generator) -> Prop:
    """Return the sheet under the locks: fine strands from the hair line to the crown."""
    turn, side = scalp.turn, np.degrees(np.abs(scalp.turn))
    share = np.concatenate([[-0.02], np.linspace(0.0, 1.0, ROWS - 1) ** 1.5])[:, None]
    grid, outwards = scalp.at(turn + 0 * share, low + (RAYS - 1 - low) * share)
    hangs = _hangs(style, side)
    strand = gaussian_filter1d(generator.normal(0, 1.0, len(turn)), 0.8, mode="wrap")
    thick = _thickness(style, side, share) + 0.25 * strand * np.sin(np.pi * share)
    if style.falls:
        thick = thick * (1 - 0.75 * _parting(style, turn, share, 22.0))
    thick[0] = -0.4 - 4.6 * hangs  # the edge is turned in
    light = 0.82 + 0.09 * strand + 0.16 * np.exp(-(((share - 0.56) / 0.10) ** 2))
    colour = np.array(recipe.props.hair_colour) * light[..., None]
    if not style.falls:
        colour[0] = recipe.props.skin_colour
    return sheet("hair", "skin", colour, grid + scale * thick[..., None] * outwards)


def _half_columns(style: Style) -> Float[np.ndarray, " half"]:
    """Return the columns' angles from the front over the left to the back, dense where the line falls."""
    fine = np.linspace(0, 180, 2001)
    density = 1 + (5 * np.exp(-(((fine - 58) / 5) ** 2)) if style.falls else 0.8 * np.exp(-(((fine - 82) / 14) ** 2)))
    length = np.concatenate([[0], np.cumsum((density[1:] + density[:-1]) / 2)])
    return np.radians(np.interp(np.linspace(0, length[-1], COLUMNS // 2 + 1), length, fine))


def _line(style: Style, recipe: Recipe, centre: np.ndarray) -> Float[np.ndarray, "knots 2"]:
    """Return the style's hair line, with the part around the ear moved to where the ears are."""
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
