"""Segments: which parts of a head share a chart, and where in it each of them lies."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from data_recipes.recipe.sections import ChartLayout

GUTTER = 0.05  # between parts in one chart: wider than a texel of 32, so that bilinear samples don't mix two parts
FACE = "face"


def segment_parts(charts: ChartLayout, part_names: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    """Return each segment's parts; the segments stand in the order of their first parts."""
    segment_of = {part: name for name, parts in charts.segments.items() for part in parts}
    segments: dict[str, tuple[str, ...]] = {}
    for part in part_names:
        name = segment_of.get(part, part)
        segments[name] = (*segments.get(name, ()), part)
    return segments


def build_segments(
    charts: ChartLayout, part: Int[np.ndarray, " n"], part_names: tuple[str, ...], uv: Float[np.ndarray, "n 2"]
) -> tuple[Int[np.ndarray, " n"], tuple[str, ...], Float[np.ndarray, "n 2"]]:
    """Return each vertex's segment, the segments' names, and the charts.

    uv: coordinates in one chart per part. The parts of a segment are stacked in rows as high as their counts of
    vertices ask for; a left part and its right one share a row, so that charts mirror as the head does. The face is cut
    into bands, called face_1 … from the chin upwards.
    """
    segment, uv, names = np.empty(len(part), np.int32), uv.copy(), []
    for name, parts in segment_parts(charts, part_names).items():
        members = {member: part == part_names.index(member) for member in parts}
        if parts == (FACE,) and charts.face_bands > 1:
            face = np.flatnonzero(members[FACE])
            band, uv[face] = cut_into_bands(uv[face], charts.face_bands, charts.evenness)
            segment[face] = len(names) + band
            names += [f"{name}_{k + 1}" for k in range(charts.face_bands)]
            continue
        _stack(members, uv)
        segment[np.any(list(members.values()), axis=0)] = len(names)
        names.append(name)
    return segment, tuple(names), uv


def cut_into_bands(
    uv: Float[np.ndarray, "n 2"], bands: int, evenness: float = 0.0
) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, "n 2"]]:
    """Cut a chart across v into bands of equally many vertices, from below; return each vertex's band and new chart.

    A band fills its chart in both directions, so that no texels are wasted; left and right stay mirrored. evenness: how
    far its vertices are spread evenly along each axis (0 to 1).
    """
    height = np.round(uv[:, 1], 9)  # so that mirror images fall into one band
    edges = np.quantile(height, np.arange(1, bands) / bands, method="closest_observation")
    band, stretched = np.searchsorted(edges, height, side="left"), uv.copy()
    for k in range(bands):
        chart = uv[band == k]
        low, high = chart.min(0), chart.max(0)
        reach = max(high[0] - 0.5, 0.5 - low[0])
        stretched[band == k, 0] = 0.5 + (chart[:, 0] - 0.5) * 0.5 / reach
        stretched[band == k, 1] = (chart[:, 1] - low[1]) / (high[1] - low[1])
        filled = stretched[band == k]
        ranks = np.stack([_ranks(filled[:, 0], mirrored=True), _ranks(filled[:, 1])], axis=1)
        stretched[band == k] = (1 - evenness) * filled + evenness * ranks
    return band, stretched


def _ranks(places: Float[np.ndarray, " n"], mirrored: bool = False) -> Float[np.ndarray, " n"]:
    """Return the places spread evenly between the lowest and the highest, in the same order.

    mirrored: keep them symmetric about ½.
    """
    places = np.round(places, 9)  # what lies level stays level
    values, index, counts = np.unique(places, return_inverse=True, return_counts=True)
    rank = np.cumsum(counts) - counts / 2
    rank = (rank - rank[0]) / (rank[-1] - rank[0])
    if mirrored:
        rank = (rank + 1 - np.interp(1 - values, values, rank)) / 2
    return (values[0] + (values[-1] - values[0]) * rank)[index]


def _stack(members: dict[str, np.ndarray], uv: Float[np.ndarray, "n 2"]) -> None:
    """Move the charts of one segment's parts into rows, in place."""
    rows = _rows(tuple(members))
    size = np.array([sum(members[name].sum() for name in row) for row in rows], float)
    high = size / size.sum() * (1 - GUTTER * (len(rows) - 1))
    low = np.cumsum(np.append(0, high[:-1] + GUTTER))
    for row, below, height in zip(rows, low, high, strict=True):
        wide = (1 - GUTTER * (len(row) - 1)) / len(row)
        for column, name in enumerate(row):
            corner = np.array([column * (wide + GUTTER), below])
            uv[members[name]] = corner + uv[members[name]] * (wide, height)


def _rows(parts: tuple[str, ...]) -> list[tuple[str, ...]]:
    """Return the parts row by row: right and left together, the character's left at the greater u."""
    rows = []
    for name in parts:
        left = name.removesuffix("_right") + "_left"
        if name.endswith("_right") and left in parts:
            continue
        right = name.removesuffix("_left") + "_right"
        rows.append((right, name) if name.endswith("_left") and right in parts else (name,))
    return rows
