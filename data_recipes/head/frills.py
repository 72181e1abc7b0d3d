"""Frills: leaf-shaped shells that stand out of the skin behind eyes and jaw, as a reptile's ear plates do.

Each is a flattened loft, closed at its tip and open at its root, which is sunk into the head without being joined to
the skin. Left side; the right one mirrors it.
"""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
from jaxtyping import Float

from data_recipes.head.shape import Shape, project, skull_distance
from data_recipes.recipe.reading import Recipe

# From the root to the tip: place along the leaf, half width, thickness (shares of the leaf's largest ones).
PROFILE = np.array(
    [
        (0.00, 0.55, 1.00),
        (0.15, 0.86, 0.90),
        (0.30, 1.00, 0.66),
        (0.50, 0.88, 0.48),
        (0.70, 0.62, 0.34),
        (0.87, 0.32, 0.24),
        (1.00, 0.06, 0.12),
    ]
)
SINK = 0.16  # share of the length by which the root lies under the skin
CUP = 0.22  # how far a leaf's margins bend forward, as a share of its half width


def frill_settings(recipe: Recipe) -> dict[str, tuple[float, ...]]:
    """Return the twelve settings of each pair of frills that a recipe has (see `recipe.sections.Frills`), by name."""
    return {name: frill for name, frill in asdict(recipe.frills).items() if isinstance(frill, tuple) and frill}


def frill_parts(recipe: Recipe) -> tuple[str, ...]:
    """Return the names of the parts: left and right of each pair."""
    return tuple(f"frill_{name}_{side}" for name in frill_settings(recipe) for side in ("left", "right"))


def frill_frame(settings: tuple[float, ...]) -> Float[np.ndarray, "3 3"]:
    """Return a left frill's axes as rows: from its root to its tip, across, and out of its front."""
    along, front = np.array(settings[3:6]), np.array(settings[6:9])
    along = along / np.linalg.norm(along)
    front = front - (front @ along) * along
    front /= np.linalg.norm(front)
    return np.stack([along, np.cross(front, along), front])


def frill_root(shape: Shape, settings: tuple[float, ...]) -> Float[np.ndarray, " 3"]:
    """Return where on the skin a left frill stands."""
    return project(lambda p: skull_distance(shape.recipe, p), np.array(settings[:3])[None], steps=8, reach_mm=20.0)[0]


def frill_positions(
    shape: Shape, settings: tuple[float, ...], rows: int, ring: int
) -> Float[np.ndarray, "rows ring 3"]:
    """Return a left frill's rings from the root on the skin to the tip; it bends towards its front by its curl."""
    length, width, curl = settings[9], settings[10], np.radians(settings[11])
    frame, root = frill_frame(settings), frill_root(shape, settings)
    phase = 2 * np.pi * (np.arange(ring) - 0.5) / ring
    out = np.empty((rows, ring, 3))
    for i, s in enumerate(np.linspace(0, 1, rows)):
        half, thick = (np.interp(s, PROFILE[:, 0], column) for column in PROFILE[:, 1:].T)
        turn = curl * s
        # An arc of a circle; for no curl its limit, a straight line.
        reach = length * (np.sinc(turn / np.pi) * s - SINK)
        rise = length * s * turn / 2 * np.sinc(turn / (2 * np.pi)) ** 2
        across = half * width / 2 * np.cos(phase)
        depth = thick * shape.recipe.frills.thickness / 2 * np.sin(phase) + CUP * half * width / 2 * np.cos(phase) ** 2
        flat = np.stack([reach - depth * np.sin(turn), across, rise + depth * np.cos(turn)], -1)
        out[i] = root + flat @ frame
    return out
