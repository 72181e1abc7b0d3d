"""The square embedding: exact on a grid, free of flips whatever lengths are wished for, and it heeds them."""

import numpy as np
import pytest

from data_recipes.head.head_charts import square_embedding


def grid(rows, columns):
    ids = np.arange(rows * columns).reshape(rows, columns)
    edges = np.concatenate(
        [np.stack([ids[:, :-1], ids[:, 1:]], -1).reshape(-1, 2), np.stack([ids[:-1], ids[1:]], -1).reshape(-1, 2)]
    )
    return ids, edges, [ids[0, :-1], ids[:-1, -1], ids[-1, :0:-1], ids[:0:-1, 0]]


def areas(ids, xy):
    """Return the areas of the triangles at every corner of every cell."""
    p = xy[ids]
    a, b, c, d = p[:-1, :-1], p[:-1, 1:], p[1:, 1:], p[1:, :-1]
    corners = ((a, b, d), (b, c, a), (c, d, b), (d, a, c))
    return np.stack([np.cross(q - p, r - p) / 2 for p, q, r in corners])


def test_a_grid_of_equal_edges_becomes_a_regular_grid():
    ids, edges, sides = grid(5, 7)
    xy = square_embedding(35, edges, np.ones(len(edges)), sides, rounds=0)
    expected = np.stack(np.meshgrid(np.linspace(0, 1, 7), np.linspace(0, 1, 5)), -1)
    np.testing.assert_allclose(xy[ids], expected, atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_no_triangle_flips_whatever_lengths_are_wanted(seed):
    ids, edges, sides = grid(9, 12)
    length = np.exp(np.random.default_rng(seed).normal(size=len(edges)))
    xy = square_embedding(108, edges, length, sides, rounds=6)
    assert areas(ids, xy).min() > 0


def test_wanted_lengths_decide_where_rows_lie():
    ids, edges, sides = grid(8, 8)
    upper = (edges // 8).min(1) >= 4
    length = np.where(upper & (edges[:, 1] - edges[:, 0] == 8), 3.0, 1.0)
    xy = square_embedding(64, edges, length, sides, rounds=6)
    np.testing.assert_allclose(xy[ids[:, 0], 1], np.cumsum([0, 1, 1, 1, 1, 3, 3, 3]) / 13, atol=1e-12)
    gaps = np.diff(xy[ids[:, 4], 1])
    assert gaps[5] > 2.5 * gaps[1]


def test_rounds_even_out_what_a_dense_patch_crowds():
    # A finer grid hangs in one cell by its corners: without rounds its vertices lie far closer together than others.
    ids, edges, sides = grid(7, 7)
    inner, more, _ = grid(4, 4)
    diagonal = np.stack([inner[:-1, :-1].ravel(), inner[1:, 1:].ravel()], -1)
    hung = np.stack([ids[2:4, 2:4].ravel(), 49 + inner[::3, ::3].ravel()], -1)
    more = np.concatenate([49 + more, 49 + diagonal, hung])
    inner = 49 + inner
    edges = np.concatenate([edges, more])
    span = []
    for rounds in (0, 6):
        xy = square_embedding(65, edges, np.ones(len(edges)), sides, rounds)
        span.append(np.linalg.norm(xy[inner[0, 0]] - xy[inner[3, 3]]))
    assert span[1] > 1.4 * span[0]
