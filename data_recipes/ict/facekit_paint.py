"""A colour for each vertex, for display only: skin with lips, the mouth's inside, gums and teeth."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int, UInt8

from data_recipes.deformers.sculpting import smoothstep
from data_recipes.ict.facekit_segments import SOFT, Segments
from data_recipes.ict.fold_regions import LIPS

SKIN, LIP = np.array([0.85, 0.66, 0.55]), np.array([0.76, 0.47, 0.43])
COLOURS = {
    "mouth": np.array([0.45, 0.17, 0.17]),
    "eye_socket_left": np.array([0.78, 0.52, 0.48]),
    "eye_socket_right": np.array([0.78, 0.52, 0.48]),
    "gums_tongue": np.array([0.78, 0.42, 0.42]),
}
IVORY = np.array([0.95, 0.93, 0.87])
LIP_EDGE_MM = 1.5  # over which the lips' colour fades, to both sides of their outline
BEHIND_MM = 16.0  # what lies farther behind the outline is not the lips


def paint(x: Float[np.ndarray, "n 3"], segments: Segments, marks: Int[np.ndarray, " l"]) -> UInt8[np.ndarray, "n 3"]:
    """Return every vertex's colour. x: the neutral, mm. marks: the 68 landmarks."""
    colour = np.tile(SKIN, (len(x), 1))
    for k, name in enumerate(segments.names):
        colour[segments.segment == k] = COLOURS.get(name, SKIN) if name in SOFT else IVORY
    outline = x[marks[LIPS]]
    inside = smoothstep(-outside(x[:, :2], outline[:, :2]), -LIP_EDGE_MM, LIP_EDGE_MM)
    front = (x[:, 2] > outline[:, 2].min() - BEHIND_MM) & (segments.segment == segments.names.index("face"))
    colour += (inside * front)[:, None] * (LIP - colour)
    return np.rint(255 * colour).astype(np.uint8)


def outside(points: Float[np.ndarray, "n 2"], polygon: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, " n"]:
    """Return how far points lie outside of a polygon, mm; inside it is less than 0."""
    a, b = polygon, np.roll(polygon, -1, axis=0)
    along, away = (b - a)[None], points[:, None] - a[None]
    share = np.clip((away * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-12), 0, 1)
    distance = np.linalg.norm(away - share[..., None] * along, axis=-1).min(axis=1)
    y = points[:, None, 1]
    crossing = (a[None, :, 1] > y) != (b[None, :, 1] > y)
    rise = np.where(np.abs(along[..., 1]) > 1e-12, along[..., 1], 1.0)
    beyond = points[:, None, 0] < a[None, :, 0] + (y - a[None, :, 1]) * along[..., 0] / rise
    return np.where((crossing & beyond).sum(axis=1) % 2 == 1, -distance, distance)
