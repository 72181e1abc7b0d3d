"""A plane, on which gradients, areas and distances are known."""

import numpy as np


def plane(rows: int = 6, columns: int = 5, jitter: float = 0.2) -> tuple[np.ndarray, np.ndarray]:
    """A jittered triangulated plane in the x-y plane, facing +z."""
    generator = np.random.default_rng(3)
    y, x = np.mgrid[:rows, :columns].astype(float)
    move = generator.uniform(-jitter, jitter, (2, rows, columns))
    move[:, [0, -1]] = 0
    move[:, :, [0, -1]] = 0
    vertices = np.stack([x + move[0], y + move[1], np.zeros_like(x)], axis=-1).reshape(-1, 3)
    i = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (part.ravel() for part in (i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]))
    return vertices, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32)
