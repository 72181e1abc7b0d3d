"""Blocks and rings of vertex indices, and the cells between them.

Ring order, everywhere: index 0 lies in the middle of a feature's outer side (the character's left; of eyes the temple,
of ears the back), then the ring runs over the top, the inner side and the bottom.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Int


def block_ring(block: Int[np.ndarray, "rows columns"]) -> Int[np.ndarray, " k"]:
    """Return a block's boundary as a ring: from the middle of its right side over the top, the left and the bottom."""
    m, h = block.shape[0] - 1, (block.shape[0] - 1) // 2
    return np.concatenate([block[h:m, -1], block[m, :0:-1], block[m:0:-1, 0], block[0, :-1], block[:h, -1]])


def grid_quads(grid: Int[np.ndarray, "rows columns"]) -> Int[np.ndarray, "q 4"]:
    """Return the cells of a grid whose rows run up and whose columns run to the right, seen from outside."""
    return np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], -1).reshape(-1, 4)


def ring_quads(rings: Int[np.ndarray, "rings k"]) -> Int[np.ndarray, "q 4"]:
    """Return the cells between closed rings, listed from the inside outwards and anticlockwise seen from outside."""
    loops = np.concatenate([rings, rings[:, :1]], 1)
    return np.stack([loops[:-1, :-1], loops[1:, :-1], loops[1:, 1:], loops[:-1, 1:]], -1).reshape(-1, 4)


def fill_block(
    ring: Int[np.ndarray, " k"], rows: int, columns: int, interior: Int[np.ndarray, "rows columns"]
) -> np.ndarray:
    """Return the (rows + 1, columns + 1) block with the given boundary ring and interior."""
    block = np.empty((rows + 1, columns + 1), int)
    block.flat[block_ring(np.arange(block.size).reshape(block.shape))] = ring
    block[1:-1, 1:-1] = interior
    return block


def ring_mirror(k: int, corner: bool = False) -> Int[np.ndarray, " k"]:
    """Return which position of a ring across the midline mirrors which.

    corner: the ring starts at a corner, as that of a block one row high does.
    """
    return (k // 2 + corner - np.arange(k)) % k
