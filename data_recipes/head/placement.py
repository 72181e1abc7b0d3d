"""Placement: where the skin's vertices lie. Weighted Laplacian relaxation alternates with projection to the SDF."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.interpolate import PchipInterpolator
from scipy.sparse import csr_matrix

from data_recipes.head.mouth import fill_cap
from data_recipes.head.shape import FLIP, Shape, project, raycast, skin_distance
from data_recipes.head.topology import Layout
from data_recipes.recipe.reading import Recipe

RING_PULL = 0.3  # weight of edges along a ring: at 1, rings slip over the corners of mouth and eyes


def body_rays(recipe: Recipe) -> tuple[Float[np.ndarray, "rows columns 3"], Float[np.ndarray, "rows columns 3"]]:
    """Return origins and directions of the body grid's rays, from the template's anchor rows and column angles."""
    t = recipe.template
    anchors, angles = np.array(t.anchors), np.array(t.angles)
    rows, half = np.arange(anchors[-1, 0] + 1), t.half_columns
    height, front, back, depth_front, depth_back = PchipInterpolator(anchors[:, 0], anchors[:, 1:])(rows).T
    side = PchipInterpolator(*angles.T)(np.arange(half + 1))
    theta = np.radians(np.concatenate([side, -side[-2:0:-1]]))
    share = ((1 + np.cos(theta)) / 2) ** 1.5  # 1 in front, 0 behind
    pitch = np.radians(back[:, None] + (front - back)[:, None] * share)
    z = depth_back[:, None] + (depth_front - depth_back)[:, None] * share
    origin = np.stack([0 * z, height[:, None] + 0 * z, z], -1)
    return origin, np.stack([np.sin(theta) * np.cos(pitch), np.sin(pitch), np.cos(theta) * np.cos(pitch)], -1)


def start(shape: Shape, layout: Layout, pins: dict[str, tuple[np.ndarray, np.ndarray]]) -> Float[np.ndarray, "n 3"]:
    """Return first positions of the surface: rays are cast for the grid, rings blended between pins and the grid."""
    x, grids = np.zeros((len(layout.part), 3)), layout.grids
    origin, direction = body_rays(shape.recipe)
    body = grids["body"]
    mask = body >= 0
    x[body[mask]] = raycast(lambda p: skin_distance(shape, p), origin[mask], direction[mask])
    for ids, position in pins.values():
        x[ids] = position
    x = mirror_left(layout, x)
    crown = grids["crown"]
    x[crown] = fill_cap(x[crown])
    t = shape.recipe.template
    fine = body[t.coarse_rows[0] : t.coarse_rows[1] + 1, t.coarse_from]
    coarse = body[t.coarse_rows[0] : t.coarse_rows[1] + 1, t.coarse_from + 1]
    for i in range(2):
        there = x[coarse[0::3][:-1]] * (2 - i) / 3 + x[coarse[0::3][1:]] * (1 + i) / 3
        x[grids["transition_left"][:, i]] = 0.5 * (x[fine[1 + i :: 3]] + there)
    for name, anchors in (
        ("mouth", (0, t.lip_rings, -1)),
        ("eye_left", (0, -1)),
        ("nostril_left", (max(t.nostril_rings - 2, 0), -1)),
    ):
        rings = grids[name]
        anchors = [k % len(rings) for k in anchors]
        for a, b in pairwise(anchors):
            for i in range(a + 1, b):
                x[rings[i]] = x[rings[a]] + (x[rings[b]] - x[rings[a]]) * (i - a) / (b - a)
    return mirror_left(layout, x)


def mirror_left(layout: Layout, x: np.ndarray) -> np.ndarray:
    """Return positions whose right half mirrors the left one."""
    left = left_half(layout)
    out = x.copy()
    out[layout.mirror[left]] = x[left] * FLIP
    middle = layout.mirror == np.arange(len(x))
    out[middle, 0] = 0.0
    return out


def left_half(layout: Layout) -> Int[np.ndarray, " h"]:
    """Return the vertices of the character's left half and of the midline."""
    half = layout.grids["body"].shape[1] // 2
    side = np.zeros(len(layout.part), int)
    for name, grid in layout.grids.items():
        if name.endswith(("_left", "_right")):
            side[grid[grid >= 0]] = 1 if name.endswith("_left") else -1
    body = layout.grids["body"]
    for columns, sign in ((body[:, 1:half], 1), (body[:, half + 1 :], -1)):
        side[columns[columns >= 0]] = sign
    for name in ("crown", "mouth_cap", "tongue_cap", "gum_upper", "gum_lower"):
        grid = layout.grids[name]
        middle = grid.shape[1] // 2
        side[grid[:, middle + 1 :]], side[grid[:, :middle]] = 1, -1
    for name in ("mouth", "mouth_bag", "tongue"):
        grid = layout.grids[name]
        k = grid.shape[1]
        turn = np.cos(2 * np.pi * np.arange(k) / k)
        side[grid[:, turn > 1e-9]], side[grid[:, turn < -1e-9]] = 1, -1
    teeth = layout.grids["teeth"]
    side[teeth] = np.where(teeth > layout.mirror[teeth], 1, -1)
    return np.flatnonzero((side > 0) | (layout.mirror == np.arange(len(side))))


def _along_rings(layout: Layout, edges: Int[np.ndarray, "e 2"]) -> Bool[np.ndarray, " e"]:
    """Return which edges run along a ring around mouth, eye or nostril."""
    ring, count = np.full(len(layout.part), -1), 0
    for name in ("mouth", "eye_left", "eye_right", "nostril_left", "nostril_right"):
        for ids in layout.grids[name][:-1]:
            ring[ids], count = count, count + 1
    return (ring[edges[:, 0]] >= 0) & (ring[edges[:, 0]] == ring[edges[:, 1]])


def relax(
    shape: Shape,
    layout: Layout,
    x: Float[np.ndarray, "n 3"],
    surface: Bool[np.ndarray, " n"],
    is_pinned: Bool[np.ndarray, " n"],
    weight: Float[np.ndarray, " n"],
) -> Float[np.ndarray, "n 3"]:
    """Return relaxed positions: heavy regions keep short edges, pinned vertices stay, all free ones lie on the SDF.

    x: first positions, mm
    surface: which vertices belong to the skin, unlike parts such as the mouth bag
    is_pinned: which of them stay
    weight: of each vertex; that of an edge is the mean of its ends
    """
    q = layout.quads
    edges = np.unique(np.sort(np.concatenate([q[:, [i, (i + 1) % 4]] for i in range(4)]), 1), axis=0)
    edges = edges[surface[edges].all(1)]
    w = weight[edges].mean(1) * np.where(_along_rings(layout, edges), RING_PULL, 1.0)
    n = len(x)
    matrix = csr_matrix(
        (
            np.concatenate([w, w]),
            (np.concatenate([edges[:, 0], edges[:, 1]]), np.concatenate([edges[:, 1], edges[:, 0]])),
        ),
        (n, n),
    )
    total = np.asarray(matrix.sum(1)).ravel()
    free = surface & ~is_pinned
    left = left_half(layout)
    left = left[free[left]]
    right = layout.mirror[left]
    rows = matrix[left]
    middle = left == right
    for i in range(shape.recipe.template.iterations + 1):
        y = 0.3 * x[left] + 0.7 * (rows @ x) / total[left, None]
        last = i == shape.recipe.template.iterations
        y = project(lambda p: skin_distance(shape, p), x[left] if last else y, steps=8 if last else 1)
        y[middle, 0] = 0.0
        x[left] = y
        x[right] = y * FLIP
    return x
