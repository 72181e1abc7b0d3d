"""Segments: which parts of a head share a chart, and where in it each of them lies."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from data_recipes.recipe.reading import Recipe

GUTTER = 0.05  # between parts in one chart: more than a texel of 32, so that bilinear samples of neighbours share none


def segment_parts(recipe: Recipe, part_names: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    """Return each segment's parts, in the order of the parts; a segment stands where its first part does."""
    home = {part: name for name, parts in recipe.segments.items() for part in parts}
    segments: dict[str, tuple[str, ...]] = {}
    for part in part_names:
        name = home.get(part, part)
        segments[name] = (*segments.get(name, ()), part)
    return segments


def part_order(recipe: Recipe, part_names: tuple[str, ...]) -> Int[np.ndarray, " p"]:
    """Return the parts' indices, those of one segment after each other."""
    index = {name: i for i, name in enumerate(part_names)}
    return np.array([index[part] for parts in segment_parts(recipe, part_names).values() for part in parts])


def build_segments(
    recipe: Recipe, part: Int[np.ndarray, " n"], part_names: tuple[str, ...], uv: Float[np.ndarray, "n 2"]
) -> tuple[Int[np.ndarray, " n"], tuple[str, ...], Float[np.ndarray, "n 2"]]:
    """Return each vertex's segment, the segments' names, and the charts.

    uv: coordinates in a chart a part. Parts of one segment are stacked in rows by their numbers of vertices; a left
    part and its right fellow share a row, so that charts mirror as the head does.
    """
    segment, uv = np.empty(len(part), np.int32), uv.copy()
    segments = segment_parts(recipe, part_names)
    for index, parts in enumerate(segments.values()):
        members = {name: part == part_names.index(name) for name in parts}
        rows = _rows(parts)
        size = np.array([sum(members[name].sum() for name in row) for row in rows], float)
        high = size / size.sum() * (1 - GUTTER * (len(rows) - 1))
        low = np.cumsum(np.append(0, high[:-1] + GUTTER))
        for row, below, height in zip(rows, low, high, strict=True):
            wide = (1 - GUTTER * (len(row) - 1)) / len(row)
            for column, name in enumerate(row):
                corner = np.array([column * (wide + GUTTER), below])
                uv[members[name]] = corner + uv[members[name]] * (wide, height)
                segment[members[name]] = index
    return segment, tuple(segments), uv


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
