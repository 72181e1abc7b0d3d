"""Small red balls that mark points of a face, as one surface."""

import numpy as np
from jaxtyping import Float

from replicate.drawing.scene import Surface

RED, RADIUS_MM = (214, 39, 40), 2.4  # of a control point


def balls(points: Float[np.ndarray, "c 3"], radius_mm: float) -> Surface:
    """Return small red balls about some points, as one surface."""
    rings, around = np.linspace(0, np.pi, 7), np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ball = np.stack(
        [
            np.sin(rings)[:, None] * np.cos(around),
            np.sin(rings)[:, None] * np.sin(around),
            np.cos(rings)[:, None] + 0 * around,
        ],
        axis=-1,
    ).reshape(-1, 3)
    row, column = np.meshgrid(np.arange(6) * 12, np.arange(12), indexing="ij")
    a, b = (row + column).ravel(), (row + (column + 1) % 12).ravel()
    faces = np.concatenate([np.stack([a, a + 12, b], 1), np.stack([b, a + 12, b + 12], 1)])
    vertices = (points[:, None] + radius_mm * ball).reshape(-1, 3)
    every = (faces[None] + len(ball) * np.arange(len(points))[:, None, None]).reshape(-1, 3)
    return Surface(vertices.astype(np.float32), every.astype(np.int32), RED, lit=False, framed=False)


def balls_in_front(
    points: Float[np.ndarray, "c 3"], vertices: Float[np.ndarray, "n 3"], radius_mm: float = RADIUS_MM
) -> Surface:
    """Return balls that are brought before a face along the view, so that none is hidden.

    Depth does not count in posing (§5.3.1). vertices: of the face, mm.
    """
    front = float(vertices[:, 2].max()) + radius_mm
    return balls(np.concatenate([points[:, :2], np.full((len(points), 1), front)], axis=1), radius_mm)
