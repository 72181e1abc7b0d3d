"""Mouth curves and the mouth bag, in wrapped coordinates so that a mouth may follow a snout."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from data_recipes.head.shape import Shape, raycast, skin_distance, wrapped_rays
from data_recipes.recipe.reading import Recipe

SEAM_DIP = 0.5  # mm; behind the seam closed lips meet this much lower, so that nothing is seen through the gap

Curve = Float[np.ndarray, " k"]


def ring_parameter(k: int) -> tuple[Curve, Curve]:
    """Return u in [-1, 1] (+1 at index 0) and the side (+1 upper, -1 lower, 0 corners) of a ring of k positions."""
    i = np.arange(k)
    half = k // 2
    u = np.where(i <= half, 1 - 2 * i / half, -1 + 2 * (i - half) / half)
    return u, np.where(i % half == 0, 0, np.where(i < half, 1, -1)).astype(float)


def seam(recipe: Recipe, u: Curve) -> Curve:
    """Return the height b of the lip seam at u."""
    m = recipe.mouth
    return m.y - 0.3 + m.corner_curl * np.abs(u) ** 2.2 - 0.6 * u * u


def vermilion(recipe: Recipe, u: Curve, side: Curve) -> Curve:
    """Return the height b of the border between lip and skin at u."""
    m, s, v = recipe.mouth, seam(recipe, u), np.minimum(np.abs(u), 1.0)
    bow = (
        7.6 * (1 - v**1.7) ** 0.9
        - 1.6 * np.exp(-((u / 0.13) ** 2))
        + 0.8 * np.exp(-(((v - 0.3) / 0.2) ** 2)) * (1 - v**6)
    )
    upper = s + m.upper_fullness * bow
    lower = s - 9.6 * m.lower_fullness * (1 - v**2.2) ** 0.9
    return np.where(side > 0, upper, np.where(side < 0, lower, s))


def on_surface(shape: Shape, a: Curve, b: Curve) -> Float[np.ndarray, "k 3"]:
    """Return the surface points at wrapped coordinates."""
    origins, directions = wrapped_rays(shape.recipe, a, b)
    return raycast(lambda p: skin_distance(shape, p), origins, directions)


def lip_pins(shape: Shape, k: int) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3"]]:
    """Return the pinned positions of the lip seam's ring and of the vermilion border's ring."""
    recipe, (u, side) = shape.recipe, ring_parameter(k)
    m = recipe.mouth
    seam_ring = on_surface(shape, m.half_width * u, seam(recipe, u))
    seam_ring[:, 1] += m.half_gap * side
    v = np.sign(u) * (1 - (1 - np.abs(u)) ** 1.15)  # denser towards the corners, where the lips taper
    border = on_surface(shape, (1 + m.corner_reach) * m.half_width * v, vermilion(recipe, v, side))
    return seam_ring, border


def corner_pins(shape: Shape) -> Float[np.ndarray, "r 3"]:
    """Return pins for the first rings at the left corner of the mouth, where free vertices slip over the seam's end."""
    m, t = shape.recipe.mouth, shape.recipe.template
    lip_rings = t.lip_rings
    ring = np.arange(1, min(lip_rings + t.corner_rings + 1, t.mouth_rings))
    reach = 1 + m.corner_reach * ring / lip_rings + 0.3 * m.corner_reach * np.maximum(ring - lip_rings, 0)
    return on_surface(shape, m.half_width * reach, np.full(len(ring), seam(shape.recipe, np.ones(1))[0]))


def bag_positions(recipe: Recipe, seam_ring: Float[np.ndarray, "k 3"], rings: int) -> Float[np.ndarray, "rings k 3"]:
    """Return the mouth bag's rings, outermost first.

    `mouth.bag_rings` has (growth of the angle in radians, half height, depth behind the lips) for each. The first ones
    run back from the seam where the lips touch, later ones open into an ellipse.
    """
    m, k = recipe.mouth, len(seam_ring)
    u, side = ring_parameter(k)
    radius = np.hypot(seam_ring[:, 0], seam_ring[:, 2] - m.axis_z)
    phase = np.pi * np.arange(k) / (k // 2)
    order = np.argsort(u[: k // 2 + 1])
    outline = np.interp(np.cos(phase), u[: k // 2 + 1][order], radius[: k // 2 + 1][order])
    middle = (1 - m.bag_wrap) * radius.max() + m.bag_wrap * outline
    out = np.empty((rings, k, 3))
    for i, (growth, half_height, depth) in enumerate(m.bag_rings):
        open_ = np.clip(half_height / 8.0, 0.0, 1.0)
        v = (1 - open_) * u + open_ * np.cos(phase)
        lift = (1 - open_) * side * half_height + open_ * np.sin(phase) * half_height
        angle = v * (m.half_width / m.axis_radius + growth)
        r = (1 - open_) * radius + open_ * middle - depth
        dip = SEAM_DIP * np.clip(min(depth / 1.6, (4.5 - depth) / 2.9), 0, 1)
        b = (1 - open_) * (seam(recipe, u) - dip) + open_ * (m.y - 0.8) + lift
        out[i] = np.stack([r * np.sin(angle), b, m.axis_z + r * np.cos(angle)], -1)
    return out


def fill_cap(ring_block: Float[np.ndarray, "rows columns 3"]) -> Float[np.ndarray, "rows columns 3"]:
    """Return a block whose interior is blended from its boundary (a Coons patch)."""
    p = ring_block.copy()
    s = np.linspace(0, 1, p.shape[0])[:, None, None]
    t = np.linspace(0, 1, p.shape[1])[None, :, None]
    a = (1 - s) * p[:1] + s * p[-1:]
    b = (1 - t) * p[:, :1] + t * p[:, -1:]
    c = (1 - s) * ((1 - t) * p[0, 0] + t * p[0, -1]) + s * ((1 - t) * p[-1, 0] + t * p[-1, -1])
    patch = a + b - c
    p[1:-1, 1:-1] = patch[1:-1, 1:-1]
    return p
