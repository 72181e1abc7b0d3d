"""Signed distances of primitives and their smooth combinations (mm; negative inside)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

Points = Float[np.ndarray, "k 3"]
Distances = Float[np.ndarray, " k"]
Distance = Callable[[Points], Distances]
Vector = tuple[float, float, float] | Float[np.ndarray, " 3"]


def lengths(v: Points) -> Distances:
    """Return the vectors' lengths as numpy's norm does, in a fifth of its time: it is slow along an axis of three."""
    x, y, z = v.T
    return np.sqrt(x * x + y * y + z * z)


def ellipsoid(p: Points, centre: Vector, radii: Vector) -> Distances:
    """Return the usual first-order distance to an ellipsoid, k0 (k0 - 1) / k1."""
    q = p - np.asarray(centre)
    k0, k1 = lengths(q / radii), lengths(q / np.square(radii))
    return k0 * (k0 - 1.0) / np.maximum(k1, 1e-9)


def cone(p: Points, a: Vector, b: Vector, radius_a: float, radius_b: float) -> Distances:
    """Return the distance to the segment a-b minus a radius that runs linearly from one end to the other."""
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
    """Return where rays, followed from afar back to their origins, first meet the surface; else their origins."""
    t = np.full(len(origins), far_mm)
    for _ in range(steps):
        d = sdf(origins + t[:, None] * directions)
        t = np.maximum(t - 0.8 * d, 0.0)
        if np.abs(d).max() < 1e-3:
            break
    return origins + t[:, None] * directions
