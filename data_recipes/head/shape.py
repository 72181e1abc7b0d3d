"""The head's shape: an SDF of some 25 primitives, in three versions.

`skull_distance` has neither lips nor lids (skin slides on it), `lidded_distance` has lids, `skin_distance` has both.
Left and right come from |x|.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from data_recipes.recipe.reading import Recipe

FLIP = np.array([-1.0, 1.0, 1.0])  # a vector times this is its mirror image


def smoothstep(x: float | np.ndarray, low: float, high: float) -> float | np.ndarray:
    """Return 0 below `low`, 1 above `high`, and a smooth rise between them; `low` may be the larger."""
    t = np.clip((x - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)


# Signed distances of primitives and their smooth combinations (mm; negative inside).

Points = Float[np.ndarray, "k 3"]
Distances = Float[np.ndarray, " k"]
Distance = Callable[[Points], Distances]
Vector = tuple[float, float, float] | Float[np.ndarray, " 3"]


def lengths(v: Points) -> Distances:
    """Return the vectors' lengths, five times as fast as numpy's norm, which is slow along an axis of three."""
    x, y, z = v.T
    return np.sqrt(x * x + y * y + z * z)


def ellipsoid(p: Points, centre: Vector, radii: Vector) -> Distances:
    """Return the usual first-order distance to an ellipsoid, k0 (k0 - 1) / k1."""
    q = p - np.asarray(centre)
    k0, k1 = lengths(q / radii), lengths(q / np.square(radii))
    return k0 * (k0 - 1.0) / np.maximum(k1, 1e-9)


def cone(p: Points, a: Vector, b: Vector, radius_a: float, radius_b: float) -> Distances:
    """Return the distance to a rounded cone around the segment a-b: the radius changes linearly along it."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    axis = b - a
    q = p - a
    t = np.clip(q @ axis / (axis @ axis), 0.0, 1.0)
    return lengths(q - t[:, None] * axis) - (radius_a + (radius_b - radius_a) * t)


def smooth_min(a: Distances, b: Distances, k: float) -> Distances:
    """Return the union of two shapes, rounded where they are within k of each other."""
    h = np.maximum(k - np.abs(a - b), 0.0)
    return np.minimum(a, b) - h * h / (4.0 * k)


def smooth_max(a: Distances, b: Distances, k: float) -> Distances:
    """Return the intersection of two shapes, rounded within k."""
    return -smooth_min(-a, -b, k)


def soft_abs(x: Distances, softness: float) -> Distances:
    """Return |x| with its kink rounded: sqrt(x^2 + softness)."""
    return np.sqrt(x * x + softness)


_TETRAHEDRON = np.array([[1.0, -1, -1], [-1, -1, 1], [-1, 1, -1], [1, 1, 1]])


def distance_and_gradient(sdf: Distance, p: Points, step_mm: float = 0.05) -> tuple[Distances, Points]:
    """Return an SDF's values and gradients by four evaluations at the corners of a small tetrahedron."""
    corners = (p[None] + step_mm * _TETRAHEDRON[:, None]).reshape(-1, 3)
    values = sdf(corners).reshape(4, -1)
    return values.mean(0), np.einsum("ck,cd->kd", values, _TETRAHEDRON) / (4.0 * step_mm)


def project(sdf: Distance, p: Points, steps: int = 1, reach_mm: float = 6.0) -> Points:
    """Move points onto the zero set by Newton steps of at most `reach_mm`."""
    for _ in range(steps):
        d, g = distance_and_gradient(sdf, p)
        p = p - (np.clip(d, -reach_mm, reach_mm) / np.maximum((g * g).sum(-1), 0.25))[:, None] * g
    return p


def raycast(sdf: Distance, origins: Points, directions: Points, far_mm: float = 260.0, steps: int = 60) -> Points:
    """Return where rays first meet the surface on the way from far out back to their origins; else their origins.

    far_mm: how far out they begin. steps: of sphere tracing, at most.
    """
    t = np.full(len(origins), far_mm)
    for _ in range(steps):
        d = sdf(origins + t[:, None] * directions)
        t = np.maximum(t - 0.8 * d, 0.0)
        if np.abs(d).max() < 1e-3:
            break
    return origins + t[:, None] * directions


@dataclass(frozen=True)
class Shape:
    """A recipe's surface; each lip is a tube (9, 4) of centres and radii on the left side, middle first."""

    recipe: Recipe
    upper_lip: np.ndarray
    lower_lip: np.ndarray


def rotation_y(degrees: float) -> np.ndarray:
    """Return the matrix that turns row vectors about y, so that +z goes towards +x."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])


def _mirror(p: Points, softness: float) -> Points:
    return np.stack([soft_abs(p[:, 0], softness), p[:, 1], p[:, 2]], -1)


def skull_distance(recipe: Recipe, p: Points) -> Distances:
    """Return the distance to the head without lips, lids or fine detail."""
    s = recipe.skull
    near, far = _mirror(p, 0.3), _mirror(p, 36.0)
    d = ellipsoid(p, s.cranium, s.cranium_radii)
    d = smooth_min(d, ellipsoid(p, s.forehead, s.forehead_radii), 40.0)
    d = smooth_min(d, ellipsoid(p, s.face, s.face_radii), 30.0)
    angle, chin = np.array(s.jaw_angle), np.array(s.chin_corner)
    middle = (angle + chin) / 2 + np.array(s.jaw_bow)
    r = s.jaw_radius
    jaw = smooth_min(cone(far, angle, middle, r, r + 1.5), cone(far, middle, chin, r + 1.5, r), 6.0)
    d = smooth_min(d, jaw, 44.0)
    d = smooth_min(d, cone(far, s.jaw_ramus, angle, r - 2.0, r), 44.0)
    d = smooth_min(d, ellipsoid(p, s.chin, s.chin_radii), s.chin_blend)
    d = smooth_min(d, cone(p, s.neck_top, s.neck_bottom, s.neck_radii[0], s.neck_radii[1]), s.neck_radii[2])
    d = smooth_min(d, ellipsoid(near, s.cheekbone, s.cheekbone_radii), 26.0)
    d = smooth_min(d, ellipsoid(near, s.cheek, s.cheek_radii), 24.0)
    d = smooth_min(d, ellipsoid(p, s.muzzle, s.muzzle_radii), 20.0)
    d = smooth_min(d, cone(near, s.brow_inner, s.brow_outer, s.brow_radii[0], s.brow_radii[1]), s.brow_radii[2])
    socket_points = (near - np.array(s.socket)) @ rotation_y(s.socket_yaw_deg)
    d = smooth_max(d, -ellipsoid(socket_points, (0.0, 0.0, 0.0), s.socket_radii), 14.0)
    return _with_nose(recipe, d, p, near)


def _with_nose(recipe: Recipe, d: Distances, p: Points, near: Points) -> Distances:
    n = recipe.nose
    nose = cone(p, n.root, n.tip, n.root_radius, n.tip_radius)
    wing = np.array(n.wing)
    nose = smooth_min(nose, cone(near, n.sidewall, wing, n.sidewall_radii[0], n.sidewall_radii[1]), n.sidewall_radii[2])
    nose = smooth_min(
        nose, cone(p, n.tip, n.columella, n.columella_radii[0], n.columella_radii[1]), n.columella_radii[2]
    )
    d = smooth_min(d, nose, n.blend)
    return smooth_min(d, ellipsoid(near, wing, n.wing_radii), n.wing_blend)


def lid_angles(recipe: Recipe, p: Points) -> tuple[Distances, Distances, Distances]:
    """Return the azimuth and elevation (radians) on the left eye's lid ball, and the distance from its centre."""
    e = recipe.eyes
    q = (p - np.array(e.centre)) @ eye_frame(recipe).T
    r = np.sqrt((q * q).sum(-1))
    return np.arctan2(q[:, 0], q[:, 2]), np.arcsin(np.clip(q[:, 1] / np.maximum(r, 1e-9), -1, 1)), r


def eye_frame(recipe: Recipe) -> np.ndarray:
    """Return the left eye's axes as rows: towards the temple, up, and along the gaze."""
    e = recipe.eyes
    c, s = np.cos(np.radians(e.tilt_deg)), np.sin(np.radians(e.tilt_deg))
    return np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]]) @ rotation_y(e.yaw_deg)


def lid_edge(recipe: Recipe, u: Distances, upper: bool) -> Distances:
    """Return the elevation (radians) of a lid's edge at u in [-1, 1], nose to temple."""
    e, u = recipe.eyes, np.clip(u, -1, 1)
    if upper:
        return np.radians(e.upper_deg) * (1 - np.abs(u) ** 2.2) ** 0.85 * (1 - 0.12 * u)
    return -np.radians(e.lower_deg) * (1 - np.abs(u) ** 2.4) ** 0.9 * (1 + 0.15 * u)


def lidded_distance(recipe: Recipe, p: Points) -> Distances:
    """Return the distance to the head with lids and fine detail, without lips."""
    e, m, near = recipe.eyes, recipe.mouth, _mirror(p, 0.3)
    d = skull_distance(recipe, p)
    azimuth, elevation, r = lid_angles(recipe, near)
    d = smooth_min(d, r - (e.radius + e.lid_thickness), 7.0)
    u = azimuth / np.radians(e.half_width_deg)
    window = np.exp(-(np.abs(u) ** 4)) * np.exp(-(((r - e.radius - 3.0) / 7.0) ** 2))
    above = elevation - lid_edge(recipe, u, True) - np.radians(15.0)
    d = d + e.crease * window * (np.exp(-((above / 0.055) ** 2)) - 0.6 * np.exp(-(((above - 0.17) / 0.09) ** 2)))
    below = elevation - lid_edge(recipe, u, False) + np.radians(20.0)
    d = d + e.under_eye * window * np.exp(-((below / 0.09) ** 2))
    top, bottom, x = recipe.nose.columella[1] - recipe.nose.columella_radii[1], m.y + 7.0 * m.upper_fullness, p[:, 0]
    reach = np.exp(-(((p[:, 1] - (top + bottom) / 2) / (0.6 * max(top - bottom, 2.0))) ** 4)) * (p[:, 2] > m.axis_z)
    groove = 1.0 * np.exp(-((x / 2.6) ** 2)) - 0.8 * np.exp(-(((np.abs(x) - 5.2) / 2.0) ** 2))
    return d + m.philtrum * reach * groove


def skin_distance(shape: Shape, p: Points) -> Distances:
    """Return the distance to the whole surface, lips included."""
    d = lidded_distance(shape.recipe, p)
    near = _mirror(p, 0.3)
    m = shape.recipe.mouth
    reach = 3 * m.half_width
    close = np.flatnonzero((np.abs(p[:, 1] - m.y) < reach) & (p[:, 2] > m.axis_z - reach) & (np.abs(d) < 30))
    q = near[close]
    for tube in (shape.upper_lip, shape.lower_lip):
        lip = np.full(len(close), np.inf)
        for a, b in pairwise(tube):
            lip = np.minimum(lip, cone(q, a[:3], b[:3], a[3], b[3]))
        d[close] = smooth_min(d[close], lip, 2.5)
    return d


def wrapped_rays(recipe: Recipe, a: Distances, b: Distances) -> tuple[Points, Points]:
    """Return origins and directions of the rays at the wrapped coordinates (a across, b up)."""
    m = recipe.mouth
    angle = np.asarray(a, float) / m.axis_radius
    origin = np.stack([0 * angle, np.asarray(b, float) + 0 * angle, m.axis_z + 0 * angle], -1)
    return origin, np.stack([np.sin(angle), 0 * angle, np.cos(angle)], -1)


def build_shape(recipe: Recipe) -> Shape:
    """Lay the lips' tubes on the surface without lips, and return the whole shape."""
    m = recipe.mouth
    k, u, w, low, c = m.half_width / 24, m.upper_fullness, m.half_width, m.lower_fullness, m.corner_curl
    upper = [
        (0, 3.2 * u, 3.5 * u),
        (5.5 * k, 3.9 * u, 3.8 * u),
        (14 * k, 2.4 * u + 0.5 * c, 3.0 * u),
        (0.97 * w, -0.4 + c, 1.6),
    ]
    lower = [
        (0, -5.4 * low, 4.8 * low),
        (9 * k, -5.2 * low, 4.6 * low),
        (17 * k, -3.4 * low + 0.6 * c, 3.2 * low),
        (0.97 * w, -1.0 + c, 1.6),
    ]

    def tube(points, sink: float) -> np.ndarray:
        points = np.array(points, float)
        ends = np.concatenate([points[1:2] * (-1, 1, 1), points, 2 * points[-1:] - points[-2:-1]])
        t = np.linspace(0, 3, 9)
        i, f = np.minimum(t.astype(int), 2), (t - np.minimum(t.astype(int), 2))[:, None]
        p0, p1, p2, p3 = (ends[i + j] for j in range(4))
        spline = 0.5 * (
            2 * p1 + (p2 - p0) * f + (2 * p0 - 5 * p1 + 4 * p2 - p3) * f**2 + (3 * p1 - p0 - 3 * p2 + p3) * f**3
        )
        origins, directions = wrapped_rays(recipe, spline[:, 0], m.y + spline[:, 1])
        surface = raycast(lambda q: lidded_distance(recipe, q), origins, directions)
        _, normal = distance_and_gradient(lambda q: lidded_distance(recipe, q), surface)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        return np.concatenate([surface - normal * spline[:, 2:] * (1 - 2 * sink), spline[:, 2:]], 1)

    return Shape(recipe, tube(upper, 0.25), tube(lower, 0.35))
