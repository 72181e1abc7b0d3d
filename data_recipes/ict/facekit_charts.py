"""Charts for the model's parts: its own where a vertex has one coordinate there, else laid out anew without a seam.

A part that its artist cut open gives the vertices on the cut two coordinates, and a rig's vertex has one. Doubling
those vertices would renumber the model and leave a crack in every approximation; so such a part is embedded once more
(see `data_recipes.head.embedding`), its longest border around the unit square, its other holes bridged.
"""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from data_recipes.head.embedding import square_embedding
from data_recipes.ict.facekit_files import FaceKit
from data_recipes.ict.facekit_segments import Segments, polygon_edges
from replicate.engine.exceptions import InputError

MARGIN = 0.01
SAME = 1e-5  # coordinates closer than this are one
ROUNDS = 6  # of spreading the vertices evenly; see `square_embedding`


def build_charts(model: FaceKit, parts: Segments, soft: int) -> tuple[Float[np.ndarray, "n 2"], tuple[str, ...]]:
    """Return a coordinate in [0, 1]² per vertex and the names of the segments that were laid out anew.

    soft: so many segments, the first, deform; teeth get their first coordinate, seams or not, for nothing reads it.
    """
    uv = np.zeros((len(parts.vertices), 2))
    anew = []
    for k, name in enumerate(parts.names):
        ids = np.flatnonzero(parts.segment == k)
        inside = _inside(parts.polygons, ids)
        chart, seams = _own_chart(model.uv, parts, ids, inside)
        if seams and k < soft:
            uv[ids] = lay_out(np.searchsorted(ids, parts.polygons[inside]), parts.polygons[inside] < 0, len(ids), name)
            anew.append(name)
        else:
            uv[ids] = _fill_square(chart)
    return uv, tuple(anew)


def _inside(polygons: Int[np.ndarray, "q 4"], ids: np.ndarray) -> np.ndarray:
    return np.flatnonzero((np.isin(polygons, ids) | (polygons < 0)).all(axis=1))


def _own_chart(uv: np.ndarray, parts: Segments, ids: np.ndarray, inside: np.ndarray) -> tuple[np.ndarray, int]:
    """Return the model's coordinate of each vertex, and how many vertices have several within their segment."""
    chart = np.full((len(ids), 2), np.nan)
    low, high = np.full((len(ids), 2), np.inf), np.full((len(ids), 2), -np.inf)
    around = np.flatnonzero(np.isin(parts.polygons, ids).any(axis=1))
    for rows in (around, inside):  # a vertex takes a polygon of its own segment if it has one
        own = np.isin(parts.polygons[rows], ids)
        local = np.searchsorted(ids, parts.polygons[rows][own])
        values = uv[parts.uv_polygons[rows][own]]
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
    """Return coordinates of a disc, or of a disc with holes, without seams.

    polygons: (q, 4) of its `count` vertices; gaps: where there is none. Raises InputError for a part without border.
    """
    polygons = np.where(gaps, -1, polygons)
    edges = polygon_edges(polygons)
    loops = sorted(border_loops(polygons), key=len, reverse=True)
    if not loops:
        raise InputError(f"part '{name}': found no border, where one is needed to lay its chart out")
    hubs = [np.stack([loop, np.full(len(loop), count + i)], 1) for i, loop in enumerate(loops[1:])]
    spokes = [np.full(len(loop), max(1.0, len(loop) / (2 * np.pi))) for loop in loops[1:]]
    border = loops[0]
    quarter = [round(i * len(border) / 4) for i in range(5)]
    sides = [border[a:b] for a, b in pairwise(quarter)]
    every = np.concatenate([edges, *hubs])
    length = np.concatenate([np.ones(len(edges)), *spokes])
    try:
        return _fill_square(square_embedding(count + len(hubs), every, length, sides, ROUNDS)[:count])
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
