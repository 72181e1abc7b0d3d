"""Teeth, gums and tongue, placed behind the lips on arches that share the mouth's wrap axis."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from data_recipes.head.mouth import seam
from data_recipes.recipe.reading import Recipe

LEAN = 0.35  # how far a cone's tip stands behind its root, as a share of its width


def arch(recipe: Recipe, front_z: float, upper: bool) -> Float[np.ndarray, "s 2"]:
    """Return a dense arch (x, z) from the character's right to the left: a superellipse with its apex at `front_z`.

    The lower arch is narrower and further back by the overbite.
    """
    t = recipe.teeth
    inset = 0.0 if upper else t.overbite
    a, d, power = t.arch_half_width - inset, t.arch_depth, t.arch_power
    phase = np.linspace(-np.pi / 2, np.pi / 2, 1601)
    x = a * np.sign(np.sin(phase)) * np.abs(np.sin(phase)) ** (2 / power)
    z = front_z - inset - d + d * np.cos(phase) ** (2 / power)
    return np.stack([x, z], -1)


def along(
    curve: Float[np.ndarray, "s 2"], distance: Float[np.ndarray, " k"]
) -> tuple[Float[np.ndarray, "k 2"], Float[np.ndarray, "k 2"]]:
    """Return points and unit tangents at arc lengths from the curve's middle; past its ends it runs straight on."""
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    s = np.asarray(distance, float) + length[len(length) // 2]

    def at(place: np.ndarray) -> np.ndarray:
        point = np.stack([np.interp(place, length, c) for c in curve.T], -1)
        before, after = np.minimum(place, 0.0), np.maximum(place - length[-1], 0.0)
        first, last = curve[1] - curve[0], curve[-1] - curve[-2]
        return (
            point + before[..., None] * first / np.linalg.norm(first) + after[..., None] * last / np.linalg.norm(last)
        )

    step = at(s + 0.8) - at(s - 0.8)
    return at(s), step / np.linalg.norm(step, axis=-1, keepdims=True)


def tooth_centres(recipe: Recipe, upper: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the teeth's signed arc lengths from the middle, right to left, and their widths."""
    t = recipe.teeth
    widths = np.array(t.widths_upper if upper else t.widths_lower)[: (t.upper if upper else t.lower) // 2]
    centres = np.cumsum(widths) - widths / 2
    return np.concatenate([-centres[::-1], centres]), np.concatenate([widths[::-1], widths])


def seam_lift(recipe: Recipe, points: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, " k"]:
    """Return how far the rows of teeth rise with the lips' seam at points (x, z) of an arch."""
    m = recipe.mouth
    u = np.arctan2(points[:, 0], points[:, 1] - m.axis_z) * m.axis_radius / m.half_width
    return recipe.teeth.follow * (seam(recipe, np.clip(u, -1, 1)) - seam(recipe, np.zeros(1)))


def length_factors(recipe: Recipe, upper: bool) -> Float[np.ndarray, " teeth"]:
    """Return the teeth's lengths over `teeth.length`, right to left."""
    t = recipe.teeth
    lengths, half = t.lengths_upper if upper else t.lengths_lower, (t.upper if upper else t.lower) // 2
    left = np.array([*lengths, *[1.0] * half][:half])
    return np.concatenate([left[::-1], left])


# Height (share of the crown), width, thickness, inward shift (shares of the tooth's size). An incisor's front stays
# upright and it thins from behind, so that light falls on what a smile shows.
_INCISOR = (
    (-0.30, 0.66, 0.80, -0.02),
    (0.05, 0.80, 0.98, -0.01),
    (0.45, 0.95, 0.86, -0.06),
    (0.84, 0.98, 0.50, -0.21),
    (1.0, 0.90, 0.28, -0.28),
)
_MOLAR = (
    (-0.30, 0.74, 0.80, 0.00),
    (0.05, 0.86, 0.98, 0.00),
    (0.45, 0.96, 1.06, 0.00),
    (0.80, 0.95, 0.98, 0.0),
    (0.93, 0.74, 0.70, 0.0),
)
_CONE = (
    (-0.30, 0.95, 0.95, 0.0),
    (0.0, 0.92, 0.92, 0.0),
    (0.40, 0.66, 0.66, 0.02),
    (0.75, 0.34, 0.34, 0.06),
    (1.0, 0.07, 0.07, 0.12),
)


def tooth_positions(recipe: Recipe, front_z: float, upper: bool) -> Float[np.ndarray, "teeth v 3"]:
    """Return the teeth of one jaw: rings from the root to the biting edge, or a strip's rows over the edge inwards."""
    t = recipe.teeth
    if t.style == "strip":
        return _strip_positions(recipe, front_z, upper)
    curve, (centres, widths) = arch(recipe, front_z, upper), tooth_centres(recipe, upper)
    point, tangent = along(curve, centres)
    phase = 2 * np.pi * (np.arange(t.ring) - 0.5) / t.ring
    section = (
        np.sign(np.stack([np.cos(phase), np.sin(phase)], -1))
        * np.abs(np.stack([np.cos(phase), np.sin(phase)], -1)) ** 0.75
    )
    edge = recipe.mouth.y + t.bite_y - t.overlap / 2 * (1 if upper else -1)
    factors = length_factors(recipe, upper)
    share = np.abs(centres) / np.abs(centres).max()
    cone = t.style == "cone"
    lift = seam_lift(recipe, point)
    out = []
    for i, (p, along_x) in enumerate(zip(point, tangent, strict=True)):
        molar = 0.0 if cone else np.clip((share[i] - 0.45) / 0.25, 0, 1)
        table = np.array(_CONE) if cone else (1 - molar) * np.array(_INCISOR) + molar * np.array(_MOLAR)
        table = np.stack([np.interp(np.linspace(0, 4, t.rings), np.arange(5), column) for column in table.T], -1)
        long = factors[i] * t.length * (1 - 0.22 * molar) * (1.0 if upper else 0.86)
        long = long * (1.06 if 0.3 < share[i] < 0.42 and not cone else 1.0)
        thick = t.thickness * (0.9 + 0.45 * molar)
        labial = np.array([-along_x[1], along_x[0]])  # outwards, in (x, z)
        rings = []
        for rise, wide, deep, shift in table:
            u = section[:, 0] * wide * widths[i] / 2 * 0.97
            v = section[:, 1] * deep * thick / 2 * (1 if upper else -1)
            if cone:  # cones bend backwards along the jaw
                u = u + LEAN * widths[i] * np.sign(centres[i]) * max(rise, 0.0) ** 2
            flat = p + u[:, None] * along_x + (v - thick / 2 - shift * thick)[:, None] * labial
            tip = edge - 0.6 * molar if upper else edge + t.overbite * 0.55 * (1 - molar) - 0.4
            if cone:  # their roots stand in line, their tips don't
                tip = edge + (1 if upper else -1) * (t.length * (1.0 if upper else 0.86) - long)
            tip = tip + lift[i]
            y = tip + long * (1 - rise) if upper else tip - long * (1 - rise)
            rings.append(np.stack([flat[:, 0], np.full(t.ring, y), flat[:, 1]], -1))
        out.append(np.concatenate(rings))
    return np.array(out)


def _strip_positions(recipe: Recipe, front_z: float, upper: bool) -> Float[np.ndarray, "1 v 3"]:
    """Return a jaw's teeth as one strip, fuller in the middle of each tooth than where two meet, thin at its ends."""
    t, columns = recipe.teeth, 2 * max(recipe.teeth.upper, recipe.teeth.lower) + 1
    curve, (centres, widths) = arch(recipe, front_z, upper), tooth_centres(recipe, upper)
    reach = np.abs(centres).max() + widths[0] / 2
    point, tangent = along(curve, np.linspace(-reach, reach, columns))
    labial = np.stack([-tangent[:, 1], tangent[:, 0]], -1)
    phase = np.pi * np.linspace(-0.04, 1.04, t.ring)[:, None]
    deep, high = (np.sign(c) * np.abs(c) ** 0.5 for c in (np.cos(phase), np.sin(phase)))
    full = np.where(np.arange(columns) % 2, 1.0, 0.94)
    full[[0, -1]] = 0.3
    flat = point + (t.thickness / 2 * (full * deep - 1))[..., None] * labial
    long = (1.0 if upper else -0.86) * t.length * np.maximum(full, 0.9)
    edge = recipe.mouth.y + t.bite_y + (0.0 if upper else 0.55 * t.overbite - 0.4)
    return np.stack([flat[..., 0], edge + long * (1 - high), flat[..., 1]], -1).reshape(1, -1, 3)


def gum_positions(
    recipe: Recipe, front_z: float, upper: bool, rows: int, columns: int
) -> Float[np.ndarray, "rows columns 3"]:
    """Return a gum, a U-shaped strip over the roots.

    front_z: where the arch of the upper teeth begins, mm
    upper: whether it is the upper gum
    rows: from the outside to the tongue's side
    columns: from right to left
    """
    t, g = recipe.teeth, recipe.tongue
    curve = arch(recipe, front_z, upper)
    centres, widths = tooth_centres(recipe, upper)
    reach = np.abs(centres).max() + widths[0] / 2 + 2.0
    point, tangent = along(curve, np.linspace(-reach, reach, columns))
    labial = np.stack([-tangent[:, 1], tangent[:, 0]], -1)
    up = 1.0 if upper else -1.0
    line = recipe.mouth.y + t.bite_y + up * (t.length * (0.86 if upper else 0.72) - t.overlap / 2)
    line = line + seam_lift(recipe, point)
    out = np.empty((rows, columns, 3))
    for i, phase in enumerate(np.linspace(-0.15 * np.pi, 1.15 * np.pi, rows)):
        across = g.gum_thickness / 2 * np.cos(phase)
        flat = point + (across - t.thickness / 2) * labial
        y = line + up * g.gum_height * (0.35 - 0.55 * np.sin(phase))
        out[i] = np.stack([flat[:, 0], y, flat[:, 1]], -1)
    return out


def tongue_positions(recipe: Recipe, front_z: float, rows: int, ring: int) -> Float[np.ndarray, "rows ring 3"]:
    """Return the tongue's rings from its root to its tip: a tapered loft, arched a little, with a groove on top."""
    g, t = recipe.tongue, recipe.teeth
    phase = 2 * np.pi * np.arange(ring) / ring
    tip_z = front_z - t.thickness - 6.0
    floor = recipe.mouth.y + t.bite_y - t.length * 0.75
    out = np.empty((rows, ring, 3))
    for i, s in enumerate(np.linspace(0, 1, rows)):
        taper = np.sqrt(max(1 - (max(s - 0.35, 0) / 0.72) ** 2.4, 0.02)) * (0.86 + 0.14 * min(s / 0.3, 1))
        high = g.height * (1 - 0.55 * s**1.5) * np.sqrt(max(1 - (max(s - 0.55, 0) / 0.50) ** 3, 0.05))
        x = g.width / 2 * taper * np.cos(phase)
        groove = 0.16 * high * np.exp(-((np.cos(phase) / 0.3) ** 2)) * (np.sin(phase) > 0) * (1 - s)
        y = floor + g.height * (0.35 + 0.25 * np.sin(np.pi * s)) + np.sin(phase) * high / 2 - groove
        out[i] = np.stack([x, y, np.full(ring, tip_z - g.length * (1 - s))], -1)
    return out
