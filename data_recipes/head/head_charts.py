"""Texture charts: a coordinate in [0, 1]² per vertex, in its part's chart, without flipped or overlapping triangles.

Charts depend on the topology only, and give every vertex about the same room. What a deformation map of few texels can
hold depends on the texels per vertex, and the template is finest where faces move most.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from data_recipes.head.frills import frill_settings
from data_recipes.head.topology import CRANIUM, FACE, NECK, Layout, grid_quads
from data_recipes.recipe.reading import Recipe
from data_recipes.recipe.sections import Teeth

MOUTH_OPENING, EYE_OPENING = 0.16, 0.28  # height of the holes in the face's chart over half the rim's length
BESIDE = 1.0  # how far rows of cells beside a feature make room for its rings
EAR_HOLE = 0.6  # target length of the edges that bridge the ears' holes over that of the others
NECK_HOLE = 0.17  # radius of the hole in the neck's annulus


def build_charts(recipe: Recipe, layout: Layout) -> Float[np.ndarray, "n 2"]:
    """Return each vertex's texture coordinate: u to the character's left, v up; charts mirror as the head does."""
    uv, grids = np.full((len(layout.part), 2), np.nan), layout.grids
    _face(recipe, layout, uv)
    _cranium(recipe, layout, uv)
    _neck(layout, uv)
    frills = [grids[f"frill_{name}_left"] for name in frill_settings(recipe)]
    for rings in (grids["mouth_bag"], grids["tongue"], grids["ear_left"][-2::-1], *frills):
        _disc(layout, rings, uv)
    _lids(grids["lid_inner_left"], uv)
    for gum in ("gum_upper", "gum_lower"):
        uv[grids[gum]] = _strip(grids[gum].shape, gum == "gum_upper")
    if recipe.teeth.style == "strip":
        shape = (recipe.teeth.ring, grids["teeth"].shape[1] // recipe.teeth.ring)
        uv[grids["teeth"]] = np.stack([_strip(shape, upper).reshape(-1, 2) for upper in (True, False)])
    else:
        uv[grids["teeth"]] = _tooth(recipe.teeth)
    right = np.flatnonzero(np.isnan(uv[:, 0]))  # the right ear, inner lid and frills
    uv[right] = uv[layout.mirror[right]] * (-1, 1) + (1, 0)
    return uv


def _cells(layout: Layout, part: int) -> Int[np.ndarray, "q 4"]:
    return layout.quads[(layout.part[layout.quads] == part).all(1)]


def _edges(quads: Int[np.ndarray, "q 4"]) -> Int[np.ndarray, "e 2"]:
    return np.unique(np.sort(np.concatenate([quads[:, [i, (i + 1) % 4]] for i in range(4)]), 1), axis=0)


def _embed(uv: np.ndarray, edges: np.ndarray, length: np.ndarray, sides: list[np.ndarray], rounds: int = 6) -> None:
    """Embed a disc in the unit square, in place; vertices beyond those of the mesh only bridge holes."""
    ids, local = np.unique(edges, return_inverse=True)
    sides = [np.searchsorted(ids, side) for side in sides]
    xy = square_embedding(len(ids), local.reshape(-1, 2), length, sides, rounds)
    real = ids < len(uv)
    uv[ids[real]] = xy[real]


def _rungs(ring: Int[np.ndarray, " k"], opening: float) -> tuple[np.ndarray, np.ndarray]:
    """Bridge a ring by rungs from its upper to its lower half; return them and target lengths that make it a lens."""
    half = len(ring) // 2
    i = np.arange(1, half)
    return np.stack([ring[i], ring[-i]], -1), opening * half * np.sin(np.pi * i / half) ** 0.7


def _face(recipe: Recipe, layout: Layout, uv: np.ndarray) -> None:
    """Embed the face in the whole square; eyes and mouth are bridged, so that they come out as open lenses."""
    t, body = recipe.template, layout.grids["body"]
    c, low, high = t.face_columns, t.neck_rows, t.hair_row
    across, up = np.arange(-c, c + 1), np.arange(low, high + 1)
    sides = [body[low, across[:-1]], body[up[:-1], c], body[high, across[:0:-1]], body[up[:0:-1], -c]]
    edges, row = [_edges(_cells(layout, FACE))], np.full(len(uv), -1)
    row[body[body >= 0]] = np.indices(body.shape)[0][body >= 0]
    first, last = np.sort(row[edges[0]], 1).T
    length = [np.ones(len(first))]
    blocks = ((t.mouth_rows, t.mouth_rings), (t.eye_rows, t.eye_rings), (t.nostril_rows, t.nostril_rings))
    for (r0, r1), rings in blocks:
        length[0][(r0 <= first) & (first < last) & (last <= r1)] = 1 + BESIDE * rings / (r1 - r0)
    for name, opening in (("mouth", MOUTH_OPENING), ("eye_left", EYE_OPENING), ("eye_right", EYE_OPENING)):
        rungs, rung_length = _rungs(layout.grids[name][0], opening)
        edges.append(rungs)
        length.append(rung_length)
    _embed(uv, np.concatenate(edges), np.concatenate(length), sides)


def _cranium(recipe: Recipe, layout: Layout, uv: np.ndarray) -> None:
    """Embed the cranium in the whole square, seen from above with the hair line below.

    The ears' holes are bridged by the cells that they replaced. At the face's corner a quad may be cut so that one of
    its triangles belongs to the cranium; the border runs along that cut.
    """
    t, body = recipe.template, layout.grids["body"]
    c, low, high, half = t.face_columns + 1, t.neck_rows, t.hair_row + 1, t.half_columns
    corner = (c + t.crown_across // 2) // 2  # between the hair line's end and the crown's
    across, back, beside = np.arange(-corner, corner), np.arange(c, 2 * half - c), np.arange(corner, c)
    right = np.concatenate([body[high, beside], body[high - 1 : low : -1, c]])
    left = np.concatenate([body[low:high, -c], body[high, -beside[:0:-1]]])
    sides = [body[high, across], right, body[low, back], left]
    cut = [[body[high, c - 1], body[high - 1, c]], [body[high, 1 - c], body[high - 1, -c]]]
    edges, spare = [_edges(_cells(layout, CRANIUM)), np.array(cut)], len(uv)
    (r0, r1), (c0, c1) = t.ear_rows, t.ear_columns
    for columns in (np.arange(c0, c1 + 1), -np.arange(c0, c1 + 1)):
        block = body[r0 : r1 + 1, columns].copy()
        gaps = block < 0
        block[gaps] = spare + np.arange(gaps.sum())
        spare += int(gaps.sum())
        bridge = _edges(grid_quads(block))
        edges.append(bridge[(bridge >= len(uv)).any(1)])
    together = np.concatenate(edges)
    _embed(uv, together, np.where((together < len(uv)).all(1), 1.0, EAR_HOLE), sides, rounds=2)


def _neck(layout: Layout, uv: np.ndarray) -> None:
    """Lay the neck out as an annulus seen from below, its front above, the uppermost row outside."""
    body = layout.grids["body"]
    rows = body[: int((layout.part == NECK).sum()) // body.shape[1]]
    phase = 2 * np.pi * np.arange(rows.shape[1]) / rows.shape[1]
    radius = np.linspace(NECK_HOLE, 0.49, len(rows))
    uv[rows] = 0.5 + radius[:, None, None] * np.stack([np.sin(phase), np.cos(phase)], -1)


def _disc(layout: Layout, rings: Int[np.ndarray, "rings k"], uv: np.ndarray) -> None:
    """Embed rings in the whole square, the outermost as its border, first vertex to the right, with equal areas."""
    (count, k), cells = rings.shape, _cells(layout, int(layout.part[rings[0, 0]]))
    inside = len(cells) - k * np.arange(count)
    radius = np.sqrt(inside / inside[0])
    depth = np.full(len(uv), count)
    depth[rings] = np.arange(count)[:, None]
    edges = _edges(cells)
    i, j = np.sort(depth[edges], 1).T
    between = np.append(radius[:-1] - radius[1:], radius[-1] / np.sqrt(inside[-1]))
    along = np.append(2 * np.pi / k * radius, between[-1])
    length = np.where((i == j) & (i < count), along[i], between[np.minimum(i, count - 1)])
    eighth = k // 8
    corners = [k // 2 + eighth, k - eighth, k + eighth, k + k // 2 - eighth, k + k // 2 + eighth]
    sides = [rings[0, np.arange(a, b) % k] for a, b in pairwise(corners)]
    _embed(uv, edges, length, sides)


def _lids(rings: Int[np.ndarray, "rings k"], uv: np.ndarray) -> None:
    """Lay the left lid's rings out as circles, the one next to the rim outermost."""
    phase = 2 * np.pi * np.arange(rings.shape[1]) / rings.shape[1]
    scale = np.linspace(1.0, 0.45, len(rings))[:, None, None]
    uv[rings] = 0.5 + 0.48 * scale * np.stack([np.cos(phase), np.sin(phase)], -1)


def _tooth(teeth: Teeth) -> Float[np.ndarray, "v 2"]:
    """Return a tooth's rings as polygons around the biting edge, the root outermost."""
    phase = 2 * np.pi * (np.arange(teeth.ring) - 0.5) / teeth.ring
    radius = np.linspace(0.48, 0.16, teeth.rings)[:, None, None]
    return (0.5 + radius * np.stack([np.cos(phase), np.sin(phase)], -1)).reshape(-1, 2)


def _strip(shape: tuple[int, int], upper: bool) -> Float[np.ndarray, "rows columns 2"]:
    """Return a jaw's strip over the whole square, its outer edge at the top for the upper jaw, else at the bottom."""
    rows, columns = shape
    v = np.linspace(0.02, 0.98, rows)[:: -1 if upper else 1]
    return np.stack(np.meshgrid(np.linspace(0.02, 0.98, columns), v), -1)


# Planar embeddings without flips: Tutte's, with weights chosen so that the vertices lie evenly.

WEIGHT_RANGE = 1e5  # between the strongest and the weakest edge; keeps the system well conditioned
CORNERS = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
DIRECTIONS = np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])


def square_embedding(
    count: int,
    edges: Int[np.ndarray, "e 2"],
    length: Float[np.ndarray, " e"],
    sides: list[Int[np.ndarray, " _"]],
    rounds: int,
) -> Float[np.ndarray, "n 2"]:
    """Lay a disc out in the unit square, each vertex at the weighted mean of its neighbours [Tutte 1963].

    The border is spaced by the target lengths of its edges. No triangle flips, for any positive weights, if none has
    all its corners on one side [Floater 1997]. So weights can be chosen: every round strengthens the edges that came
    out too long and weakens the others. A few rounds are best, since many make some edges very short. The graph must be
    3-connected, as our parts without holes are; holes have to be bridged by further edges.

    count: n, the number of vertices
    edges: pairs of them
    length: the target length of each edge, relative to the others
    sides: the vertices of the lower, right, upper and left side in order, each without the next one's first corner
    rounds: of choosing weights
    """
    edges, weight = np.asarray(edges), 1.0 / np.asarray(length, float)
    target_length = {frozenset(edge): share for edge, share in zip(edges.tolist(), length.tolist(), strict=True)}
    xy = np.zeros((count, 2))
    for side, after, corner, along in zip(sides, sides[1:] + sides[:1], CORNERS, DIRECTIONS, strict=True):
        line = np.append(side, after[0]).tolist()
        share = np.cumsum([0.0] + [target_length[frozenset(edge)] for edge in pairwise(line)])
        xy[side] = corner + share[:-1, None] / share[-1] * along
    border = np.concatenate(sides)
    free = np.setdiff1d(np.arange(count), border)
    inner = ~np.isin(edges, border).all(1)
    for i in range(rounds + 1):
        xy[free] = _solve(edges, weight, free, xy)
        if i < rounds:
            weight = weight * np.sqrt(np.linalg.norm(xy[edges[:, 0]] - xy[edges[:, 1]], axis=1) / length)
            weight = np.clip(weight / np.exp(np.log(weight[inner]).mean()), WEIGHT_RANGE**-0.5, WEIGHT_RANGE**0.5)
    return xy


def _solve(edges: np.ndarray, weight: np.ndarray, free: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """Return the free vertices' positions at the weighted means of their neighbours."""
    (a, b), n = edges.T, len(xy)
    row, column = np.concatenate([a, b, a, b]), np.concatenate([b, a, a, b])
    laplacian = csc_matrix((np.concatenate([-weight, -weight, weight, weight]), (row, column)), (n, n))
    matrix = laplacian.tocsr()[free].tocsc()
    border = np.setdiff1d(np.arange(n), free)
    options = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    return splu(matrix[:, free], **options).solve(-(matrix[:, border] @ xy[border]))
