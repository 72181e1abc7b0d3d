"""Where hair lies, for display only: the skull seen from within it, and a drape over ears and neck for hair that falls.

Places on it are (turn, ray): the angle around the head from the front, positive on the character's left, and the index
of a ray that leaves the head there, from the lowest up to the crown.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from data_recipes.head.prop_mesh import FLIP, on_skin, smooth_step
from data_recipes.head.shape import skull_distance
from data_recipes.recipe.reading import Recipe

RAYS = 56
LOWEST_DEG = -62.0  # of the rays that find the skull, from the level of the temples
LOWEST_MM = -116.0  # of falling hair, on a cranium 74 mm high
HANG, RISE, ASIDE = 0.08, 0.38, 0.42  # falling hair draws in by at most this share of the way down, up and around


@dataclass(frozen=True)
class Scalp:
    """A sheet to lay hair on: points (mm) and unit normals by ray and column; `turn` are the columns' angles (rad)."""

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
    """Return the sheet that hair lies on; `x` are the head's vertices, ears included.

    half_turn: the columns' angles from the front over the left to the back, in [0, π]. falls: whether the hair hangs
    over the ears.
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
