"""Flat grids, on which gradients, areas and distances are known."""

import numpy as np


def plane(rows: int = 6, columns: int = 5, jitter: float = 0.2) -> tuple[np.ndarray, np.ndarray]:
    """A jittered triangulated plane in the x-y plane, facing +z."""
    generator = np.random.default_rng(3)
    y, x = np.mgrid[:rows, :columns].astype(float)
    move = generator.uniform(-jitter, jitter, (2, rows, columns))
    move[:, [0, -1]] = 0
    move[:, :, [0, -1]] = 0
    vertices = np.stack([x + move[0], y + move[1], np.zeros_like(x)], axis=-1).reshape(-1, 3)
    return vertices, grid_faces(rows, columns)


def flat_grid(x: np.ndarray, y: np.ndarray, z: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return a vertex at each pair of coordinates, row by row, (len(y) · len(x), 3), and faces, which face +z."""
    x, y = np.meshgrid(x, y)
    return np.stack([x, y, 0 * x + z], -1).reshape(-1, 3).astype(np.float32), grid_faces(*x.shape)


def grid_faces(rows: int, columns: int) -> np.ndarray:
    """Return two faces for each square of a grid of vertices, which are numbered row by row."""
    corner = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (part.ravel() for part in (corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]))
    return np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32)
