"""Locks of hair, for display only: ribbons with round backs that lie on the scalp, layer over layer.

A lock's edges sink into what it lies on, hair or skin, so that no gap shows under it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from data_recipes.head.prop_mesh import Prop, on_skin, sheet
from data_recipes.head.shape import FLIP, skull_distance, smoothstep
from data_recipes.recipe.reading import Recipe

# Where hair lies, for display only: the skull seen from within it, and a drape over ears and neck for hair that falls.

RAYS = 56
LOWEST_DEG = -62.0  # of the rays that find the skull, from the level of the temples
LOWEST_MM = -116.0  # of falling hair, on a cranium 74 mm high
HANG, RISE, ASIDE = 0.08, 0.38, 0.42  # falling hair draws in at most this fast: per way down, up and around


@dataclass(frozen=True)
class Scalp:
    """A sheet to lay hair on: points (mm) and unit normals by ray and column; `turn` has the columns' angles (rad)."""

    turn: Float[np.ndarray, " columns"]
    points: Float[np.ndarray, "rays columns 3"]
    normals: Float[np.ndarray, "rays columns 3"]

    def at(
        self, turn: Float[np.ndarray, "*s"], ray: Float[np.ndarray, "*s"]
    ) -> tuple[Float[np.ndarray, "*s 3"], Float[np.ndarray, "*s 3"]]:
        """Return points and unit normals between rays and columns; angles go on around the head."""
        around = np.mod(turn + np.pi, 2 * np.pi) - np.pi
        column = np.interp(around, self.turn, np.arange(len(self.turn)))
        ray = np.clip(ray, 0, len(self.points) - 1)
        i, j = np.minimum(ray.astype(int), len(self.points) - 2), np.minimum(column.astype(int), len(self.turn) - 2)
        f, g = (ray - i)[..., None], (column - j)[..., None]
        p, normal = (
            (values[i, j] * (1 - g) + values[i, j + 1] * g) * (1 - f)
            + (values[i + 1, j] * (1 - g) + values[i + 1, j + 1] * g) * f
            for values in (self.points, self.normals)
        )
        return p, normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-9)

    def ray_at(self, height: Float[np.ndarray, " columns"]) -> Float[np.ndarray, " columns"]:
        """Return at which ray, in fractions, each column crosses a height (mm) for the last time on the way up."""
        place = np.empty(len(height))
        for column, level in enumerate(height):
            y = self.points[:, column, 1]
            below = np.flatnonzero(y[:-1] <= level)
            i = below[-1] if len(below) else 0
            place[column] = i + np.clip((level - y[i]) / max(y[i + 1] - y[i], 1e-6), 0, 1)
        return place


def build_scalp(
    recipe: Recipe, half_turn: Float[np.ndarray, " half"], falls: bool, x: Float[np.ndarray, "n 3"]
) -> Scalp:
    """Return the sheet that hair lies on.

    half_turn: the columns' angles from the front over the left to the back, in [0, π]
    falls: whether the hair hangs over the ears
    x: the head's vertices, ears included, mm
    """
    points, normals = (_both_sides(half) for half in _left_half(recipe, half_turn, falls, x))
    return Scalp(np.concatenate([-half_turn[:0:-1], half_turn]), points, normals)


def head_centre(recipe: Recipe) -> Float[np.ndarray, " 3"]:
    """Return where the rays begin, mm."""
    return np.array(recipe.skull.cranium) + np.array([0.0, -14.0, 2.0])


def _both_sides(left: Float[np.ndarray, "rays half 3"]) -> Float[np.ndarray, "rays columns 3"]:
    """Return the right half's columns, mirrored, before the left ones; the first of these lies in the middle."""
    return np.concatenate([left[:, :0:-1] * FLIP, left], 1)


def _left_half(recipe: Recipe, turn, falls: bool, x) -> tuple[np.ndarray, np.ndarray]:
    """Return where the left half of the hair lies and its normals, (rays, columns, 3), from below up to the crown."""
    centre = head_centre(recipe)
    pitch = np.radians(np.linspace(LOWEST_DEG, 90, RAYS))[:, None]
    scale = recipe.skull.cranium_radii[1] / 74.0
    towards = np.stack([np.cos(pitch) * np.sin(turn), np.sin(pitch) + 0 * turn, np.cos(pitch) * np.cos(turn)], -1)
    origin = centre + 0 * towards
    if falls:  # below the temples the rays are level, to meet the neck as well
        level = np.minimum(pitch / np.radians(-LOWEST_DEG), 0)
        origin[..., 1] += np.abs(level) * (LOWEST_MM * scale - centre[1])
        aside = np.stack([np.sin(turn), 0 * turn, np.cos(turn)], -1)
        towards = np.where((pitch < 0)[..., None], aside, towards)
    hits = on_skin(lambda q: skull_distance(recipe, q), origin.reshape(-1, 3), towards.reshape(-1, 3))
    p, normal = (values.reshape(towards.shape) for values in hits)
    if not falls:
        return p, normal
    reach = np.hypot(p[..., 0], p[..., 2] - centre[2])
    tent = _drape(np.maximum(reach, _ears_reach(p, turn, centre, x)), p[..., 1], turn)
    reach = reach + smoothstep(pitch, np.radians(62), np.radians(15)) * (tent - reach)
    reach = reach - 6.0 * scale * smoothstep(p[..., 1], 0.65 * LOWEST_MM * scale, 0.9 * LOWEST_MM * scale)
    p = np.stack([reach * aside[:, 0], p[..., 1], centre[2] + reach * aside[:, 2]], -1)
    hangs = smoothstep(pitch, np.radians(25), np.radians(-5))[..., None]
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
    """Return how far out from the axis the head's vertices are near each point: the ears are beyond the skull."""
    from_axis = x - (0.0, 0.0, centre[2])
    far = np.hypot(from_axis[:, 0], from_axis[:, 2])
    angle = np.arctan2(from_axis[:, 0], from_axis[:, 2])
    reach = np.zeros(p.shape[:2])
    wide = np.flatnonzero((np.abs(np.sin(angle)) > 0.7) & (x[:, 1] > p[0, :, 1].min()))
    for column, t in enumerate(turn):
        if np.abs(np.sin(t)) < 0.7:
            continue
        close = wide[np.abs(np.angle(np.exp(1j * (angle[wide] - t)))) < np.radians(5)]
        for i, height in enumerate(p[:, column, 1]):
            near = close[np.abs(x[close, 1] - height) < 5]
            if len(near):
                reach[i, column] = far[near].max()
    return reach


POINTS = 18  # along a lock
EDGE_MM = 0.8  # how deep at most a lock's edges lie under what it lies on
NARROW = 0.30  # how broad a lock begins, as a share of its width
ROUND = 0.34  # how high a lock's back is, as a share of its half width


@dataclass(frozen=True)
class Layer:
    """A row of locks around the head, which lie over those of the layers before it.

    count: how many
    root, tip: where they begin and end on the way from the hair line (0) to the crown (1)
    half_mm: half their width
    lift_mm: how far they stand off the sheet that they lie on
    """

    count: int
    root: float
    tip: float
    half_mm: float
    lift_mm: float


@dataclass(frozen=True)
class Paths:
    """Where locks run on a scalp from root to tip, as `turn` (rad) and `ray`, and their half width and lift.

    root: how broad they begin, as a share of their width: more where they lie side by side along a parting
    """

    turn: Float[np.ndarray, "locks points"]
    ray: Float[np.ndarray, "locks points"]
    half_mm: Float[np.ndarray, " locks"]
    lift_mm: Float[np.ndarray, " locks"]
    root: Float[np.ndarray, " locks"]


def combed(
    layer: Layer,
    scalp: Scalp,
    low: Float[np.ndarray, " columns"],
    fringe: float,
    part_deg: float,
    sweep_deg: float,
    generator: np.random.Generator,
) -> Paths:
    """Return a layer of locks that run from the crown to the hair line.

    low: the hair line's ray by column
    fringe: how far the front ones hang below the line, as a share of the way up
    part_deg, sweep_deg: the angle at which the front ones part, and how far they are swept aside
    """
    count = layer.count
    t = np.linspace(0, 1, POINTS)
    start = 2 * np.pi * (np.arange(count) + generator.uniform(-0.35, 0.35, count)) / count - np.pi
    front = ((1 + np.cos(start)) / 2) ** 2
    part = np.radians(part_deg)
    sweep = np.radians(sweep_deg) * np.tanh((start - part) / 0.35) * front + generator.normal(0, 0.05, count)
    turn = start[:, None] + sweep[:, None] * t**1.4
    turn = turn + 0.035 * np.sin(4.5 * t + generator.uniform(0, 2 * np.pi, (count, 1))) * t
    root = layer.root + generator.uniform(-0.06, 0.06, count)
    tip = layer.tip + generator.uniform(-0.05, 0.05, count) * (1 - front)
    tip = tip - fringe * front * generator.uniform(0.15, 1.0, count) * (layer.tip < 0.1)
    share = np.minimum(root[:, None] + (tip - root)[:, None] * t, 0.995)
    below = np.interp(np.mod(turn + np.pi, 2 * np.pi) - np.pi, scalp.turn, low)
    ray = below + (RAYS - 1 - below) * share
    wide = layer.half_mm * generator.uniform(0.8, 1.25, count)
    return Paths(turn, ray, wide, layer.lift_mm * generator.uniform(0.8, 1.2, count), np.full(count, NARROW))


def falling(
    scalp: Scalp, low: Float[np.ndarray, " columns"], part_deg: float, generator: np.random.Generator
) -> list[Paths]:
    """Return two layers of locks that fall to the hair line: at the back from the crown, in front from a parting."""
    t = np.linspace(0, 1, POINTS)

    def fall(turn, first, last, half_mm, lift_mm, fringe=0.0, root=NARROW):
        below = np.interp(np.mod(turn + np.pi, 2 * np.pi) - np.pi, scalp.turn, low)
        lowest = below - 0.5 - 0.5 * t**6 - fringe * np.sin(np.pi * np.minimum(2 * t, 1))
        ray = first[:, None] + (last - first)[:, None] * t**1.25
        ray = gaussian_filter1d(np.maximum(ray, lowest), 1.8, axis=1, mode="nearest")
        count = len(turn)
        half_mm = half_mm * generator.uniform(0.85, 1.2, count)
        return Paths(turn, ray, half_mm, np.full(count, lift_mm), np.broadcast_to(root, count))

    count = 34
    back = np.radians(np.linspace(66, 294, count) + generator.uniform(-2, 2, count))
    end = np.interp(np.mod(back + np.pi, 2 * np.pi) - np.pi, scalp.turn, low) + generator.uniform(-0.9, 0.2, count)
    wave = 0.03 * np.sin(5 * t + generator.uniform(0, 2 * np.pi, (count, 1)))
    layers = [fall(back[:, None] + wave, np.full(count, RAYS - 2.0), end, 10.0, 1.2)]
    count = 20
    for side in (-1, 1):
        place = np.linspace(1, 0, count)  # from the crown to the forehead, which lies on top
        part = np.interp(np.radians(part_deg), scalp.turn, low)
        first = part - 0.2 + place * (RAYS - 3.0 - part)
        aside = np.radians(59.5 + 52 * place + generator.uniform(-1, 1, count))
        end = np.interp(side * aside, scalp.turn, low) + generator.uniform(-0.9, 0.2, count)
        root = np.radians(part_deg - 0.4 * side)  # they cross, so that no gap shows
        turn = root + (side * aside - root)[:, None] * np.tanh(2.6 * t) / np.tanh(2.6)
        fringe = 3.5 * smoothstep(place, 0.45, 0.0)[:, None]  # the foremost ones lie on the forehead
        layers.append(fall(turn, first, end, 8.5, 2.0, fringe, 0.45 + 0.55 * place))
    return layers


def ribbons(
    scalp: Scalp,
    paths: Paths,
    base_mm: Float[np.ndarray, "locks points"],
    colour: tuple[float, float, float],
    scale: float,
    blunt: float,
    generator: np.random.Generator,
    across_count: int = 7,
) -> list[Prop]:
    """Return a prop for each lock.

    scalp, paths: where the locks lie
    base_mm: thickness of the hair under them
    colour: RGB in [0, 1]
    scale: of lengths
    blunt: 2 for locks that end in a point, more for broader ends
    across_count: points across a lock
    """
    # where the middles of the locks lie
    t, a = np.linspace(0, 1, paths.turn.shape[1]), np.linspace(-1, 1, across_count)
    p, normal = scalp.at(paths.turn, paths.ray)
    up = -np.gradient(p, axis=1)
    across = np.cross(up, normal)
    across /= np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-9)
    # their form
    taper = (1 - (1 - paths.root[:, None]) * smoothstep(t, 0.35, 0)) * (1 - t**blunt) ** 0.75 + 0.03
    half = scale * paths.half_mm[:, None] * taper
    lift = paths.lift_mm[:, None] * smoothstep(t, 0, 0.3) * (1 - 0.8 * smoothstep(t, 0.55, 1))
    edge = np.minimum(EDGE_MM, 0.6 * half)
    back = edge + scale * lift + ROUND * half
    back = back * smoothstep(t, -0.05, 0.2)
    height = scale * base_mm - edge
    arch = 1 - np.abs(a) ** 2.3
    grid = (
        p[:, :, None]
        + (half[..., None] * a)[..., None] * across[:, :, None]
        + (height[..., None] + back[..., None] * arch)[..., None] * normal[:, :, None]
    )
    # their colours
    count = len(p)
    tone, phase = generator.uniform(0.86, 1.12, (count, 1, 1)), generator.uniform(0, 2 * np.pi, (count, 1, 1))
    strands = 0.09 * np.cos(3.1 * np.pi * a + phase + 1.5 * t[:, None]) + 0.04 * np.cos(9 * a - phase)
    light = tone * (0.80 + 0.20 * smoothstep(t, 0, 0.3) + 0.10 * smoothstep(t, 0.5, 1.0))[:, None] + strands
    gloss = 0.20 * np.exp(-(((paths.ray / (RAYS - 1) - 0.80) / 0.07) ** 2))
    light = (light + gloss[..., None]) * (1 - 0.30 * np.abs(a) ** 3)
    warm = 1 + generator.uniform(-0.06, 0.06, (count, 1, 1, 1)) * np.array([0.3, 1.0, 1.6])
    rgb = np.asarray(colour) * warm * light[..., None]
    return [sheet("lock", "skin", rgb[k, ::-1], grid[k, ::-1]) for k in range(count)]
