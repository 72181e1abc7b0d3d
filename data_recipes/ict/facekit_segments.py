"""The model's parts as segments: the vertices that are approximated, their triangles, and each tooth by itself."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int
from scipy.sparse.csgraph import connected_components

from data_recipes.head.head_charts import square_embedding
from data_recipes.ict.facekit_files import FaceKit
from data_recipes.recipe.facekit import Parts
from replicate.base.exceptions import InputError

# The skin, the sockets behind the lids and the mouth's inside; each tooth is one more segment.
SOFT = ("face", "head", "mouth", "eye_socket_left", "eye_socket_right", "gums_tongue")
JAW_OPEN = "jawOpen"
TIE_MM = 1e-9  # of diagonals that differ by less, the first is taken


@dataclass(frozen=True)
class Segments:
    """The approximated part of the model.

    vertices: their indices in the model; all other indices count in this order.
    polygons, uv_polygons: as in FaceKit, with these indices.
    segment: of each vertex, an index into `names`.
    lower: the names of the jaw's teeth.
    """

    vertices: Int[np.ndarray, " n"]
    polygons: Int[np.ndarray, "q 4"]
    uv_polygons: Int[np.ndarray, "q 4"]
    faces: Int[np.ndarray, "f 3"]
    segment: Int[np.ndarray, " n"]
    names: tuple[str, ...]
    lower: tuple[str, ...]

    def members(self, *names: str) -> Int[np.ndarray, " k"]:
        """Return the vertices of some segments."""
        return np.flatnonzero(np.isin(self.segment, [self.names.index(name) for name in names]))


def split(model: FaceKit, parts: Parts, file: str) -> Segments:
    """Return the model's parts as segments, and each connected piece of its teeth as one.

    file: the recipe, for messages. Raises InputError for parts that share a vertex, and for a polygon that lies partly
    outside of them.
    """
    ranges = {name: np.arange(getattr(parts, name)[0], getattr(parts, name)[1] + 1) for name in (*SOFT, "teeth")}
    vertices = np.concatenate(list(ranges.values()))
    if len(np.unique(vertices)) < len(vertices):
        raise InputError(f"{file}: 'parts': a vertex is in two of {', '.join(ranges)}, expected one")
    place = np.full(len(model.vertices) + 1, -1)  # the last stands for "no fourth corner"
    place[vertices] = np.arange(len(vertices))
    corners = np.where(model.polygons < 0, len(model.vertices), model.polygons)
    polygons = place[corners]
    inside_count = (polygons >= 0).sum(axis=1)
    corner_count = (model.polygons >= 0).sum(axis=1)
    partial_faces = np.flatnonzero((inside_count > 0) & (inside_count < corner_count))
    if len(partial_faces):
        face = model.polygons[partial_faces[0]].tolist()
        raise InputError(f"{file}: 'parts': the face {face} lies partly outside of {', '.join(ranges)}")
    keep = inside_count == corner_count
    polygons = polygons[keep]

    segment = np.repeat(np.arange(len(ranges)), [len(ids) for ids in ranges.values()])
    teeth = np.flatnonzero(segment == len(SOFT))
    names, lower = list(SOFT), []
    for name, members, in_jaw in _teeth(model, vertices, polygons, teeth):
        segment[members] = len(names)
        names.append(name)
        lower += [name] * in_jaw
    faces = triangles(polygons, model.vertices[vertices], _ears(polygons, segment))
    return Segments(vertices, polygons, model.uv_polygons[keep], faces, segment, tuple(names), tuple(lower))


def _teeth(model: FaceKit, vertices: np.ndarray, polygons: np.ndarray, teeth: np.ndarray):
    """Return (name, vertices, whether the jaw carries it) of each tooth, upper ones first, from right to left."""
    edges = polygon_edges(polygons)
    graph = sp.csr_matrix((np.ones(len(edges)), edges.T), shape=(len(vertices),) * 2)
    count, owner = connected_components(graph[teeth][:, teeth], directed=False)
    members = [teeth[owner == k] for k in range(count)]
    travel = np.linalg.norm(model.offsets[JAW_OPEN][vertices], axis=1)
    in_jaw = [bool(travel[ids].mean() > 0.5 * travel[teeth].max()) for ids in members]
    along = [model.vertices[vertices[ids], 0].mean() for ids in members]
    entries, counts = [], {"upper": 0, "lower": 0}
    for k in sorted(range(count), key=lambda k: (in_jaw[k], along[k])):
        jaw = "lower" if in_jaw[k] else "upper"
        counts[jaw] += 1
        entries.append((f"tooth_{jaw}_{counts[jaw]:02d}", members[k], in_jaw[k]))
    return entries


def _ears(polygons: np.ndarray, segment: np.ndarray) -> np.ndarray:
    """Return (n,) bool: corners that stick out, vertices of just one quad within their segment.

    A quad is cut through such a corner: the other diagonal gives a triangle that is flat where the border of a chart is
    straight.
    """
    quads = polygons[polygons[:, 3] >= 0]
    owner = segment[quads]
    within = quads[(owner == owner[:, :1]).all(axis=1)]
    return np.bincount(within.ravel(), minlength=len(segment)) == 1


def polygon_edges(polygons: Int[np.ndarray, "q 4"]) -> Int[np.ndarray, "e 2"]:
    """Return the polygons' edges, without diagonals, each once, smaller index first."""
    quads, trios = polygons[polygons[:, 3] >= 0], polygons[polygons[:, 3] < 0, :3]
    pairs = [np.stack([p, np.roll(p, -1, axis=1)], axis=-1).reshape(-1, 2) for p in (quads, trios)]
    return np.unique(np.sort(np.concatenate(pairs), axis=1), axis=0)


def triangles(
    polygons: Int[np.ndarray, "q 4"], x: Float[np.ndarray, "n 3"], through: Bool[np.ndarray, " n"] | None = None
) -> Int[np.ndarray, "f 3"]:
    """Return triangles in the polygons' order.

    Quads are cut along their shorter diagonal, or through a corner of `through` if they have one.
    """
    quad = polygons[:, 3] >= 0
    a, b, c, d = polygons.T
    other = np.linalg.norm(x[b] - x[d], axis=1) < np.linalg.norm(x[a] - x[c], axis=1) - TIE_MM
    if through is not None:
        other = (other & ~(through[a] | through[c])) | through[b] | through[d]
    other &= quad
    first = np.where(other[:, None], np.stack([a, b, d], 1), np.stack([a, b, c], 1))
    second = np.where(other[:, None], np.stack([b, c, d], 1), np.stack([a, c, d], 1))
    both = np.stack([first, second], axis=1).reshape(-1, 3)
    return both[np.stack([np.ones(len(quad), bool), quad], axis=1).ravel()]


# Charts for the model's parts: those of the model where each vertex has one coordinate, new ones where there are seams.

MARGIN = 0.01
SAME = 1e-5  # coordinates closer than this are equal
ROUNDS = 6  # of spreading the vertices evenly; see `square_embedding`


def build_charts(model: FaceKit, parts: Segments, soft: int) -> tuple[Float[np.ndarray, "n 2"], tuple[str, ...]]:
    """Return a coordinate in [0, 1]² for each vertex and the names of the segments that were laid out anew.

    soft: how many segments, the first ones, deform. Teeth don't: no one reads their charts, and seams don't matter.
    """
    uv = np.zeros((len(parts.vertices), 2))
    anew = []
    for k, name in enumerate(parts.names):
        ids = np.flatnonzero(parts.segment == k)
        inside = _inside(parts.polygons, ids)
        chart, seams = _model_chart(model.uv, parts, ids, inside)
        if seams and k < soft:
            uv[ids] = lay_out(np.searchsorted(ids, parts.polygons[inside]), parts.polygons[inside] < 0, len(ids), name)
            anew.append(name)
        else:
            uv[ids] = _fill_square(chart)
    return uv, tuple(anew)


def _inside(polygons: Int[np.ndarray, "q 4"], ids: np.ndarray) -> np.ndarray:
    return np.flatnonzero((np.isin(polygons, ids) | (polygons < 0)).all(axis=1))


def _model_chart(uv: np.ndarray, parts: Segments, ids: np.ndarray, inside: np.ndarray) -> tuple[np.ndarray, int]:
    """Return the model's coordinate of each vertex, and how many vertices have several within their segment."""
    chart = np.full((len(ids), 2), np.nan)
    low, high = np.full((len(ids), 2), np.inf), np.full((len(ids), 2), -np.inf)
    around = np.flatnonzero(np.isin(parts.polygons, ids).any(axis=1))
    for rows in (around, inside):  # the last wins: polygons within the segment
        corners = np.isin(parts.polygons[rows], ids)
        local = np.searchsorted(ids, parts.polygons[rows][corners])
        values = uv[parts.uv_polygons[rows][corners]]
        chart[local[::-1]] = values[::-1]
    np.minimum.at(low, local, values)
    np.maximum.at(high, local, values)
    several = ((high - low) > SAME).any(axis=1)
    return chart, int(several.sum())


def _fill_square(chart: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, "k 2"]:
    """Stretch a chart over the unit square, up to a margin: maps have few texels, and all should be used."""
    low, span = chart.min(axis=0), np.maximum(np.ptp(chart, axis=0), 1e-9)
    return MARGIN + (1 - 2 * MARGIN) * (chart - low) / span


def lay_out(polygons: Int[np.ndarray, "q 4"], gaps: np.ndarray, count: int, name: str) -> Float[np.ndarray, "k 2"]:
    """Return coordinates without seams for a part that is a disc, with or without holes.

    polygons: of its `count` vertices; gaps: (q, 4) bool, where a polygon has no corner.
    Raises InputError for a part without a border.
    """
    polygons = np.where(gaps, -1, polygons)
    edges = polygon_edges(polygons)
    loops = sorted(border_loops(polygons), key=len, reverse=True)
    if not loops:
        raise InputError(f"part '{name}': it has no border, which its chart needs")
    hubs = [np.stack([loop, np.full(len(loop), count + i)], 1) for i, loop in enumerate(loops[1:])]
    spokes = [np.full(len(loop), max(1.0, len(loop) / (2 * np.pi))) for loop in loops[1:]]
    border = loops[0]
    quarter = [round(i * len(border) / 4) for i in range(5)]
    sides = [border[a:b] for a, b in pairwise(quarter)]
    all_edges = np.concatenate([edges, *hubs])
    length = np.concatenate([np.ones(len(edges)), *spokes])
    try:
        return _fill_square(square_embedding(count + len(hubs), all_edges, length, sides, ROUNDS)[:count])
    except RuntimeError as error:  # of the sparse solver
        raise InputError(f"part '{name}': its chart can't be laid out ({error}): it must be one piece") from error


def border_loops(polygons: Int[np.ndarray, "q 4"]) -> list[Int[np.ndarray, " k"]]:
    """Return the borders of a surface, each as its vertices in order."""
    directed_edges = []
    for polygon in polygons.tolist():
        ring = [v for v in polygon if v >= 0]
        directed_edges += list(zip(ring, ring[1:] + ring[:1], strict=True))
    count = Counter(tuple(sorted(edge)) for edge in directed_edges)
    after = {a: b for a, b in directed_edges if count[tuple(sorted((a, b)))] == 1}
    loops = []
    while after:
        start, vertex = next(iter(after.items()))
        loop = [start]
        del after[start]
        while vertex != start and vertex in after:
            loop.append(vertex)
            vertex = after.pop(vertex)
        loops.append(np.array(loop))
    return loops
