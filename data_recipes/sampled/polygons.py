"""Polygons of any number of corners, cut into triangles along their insides.

A polygon whose corners a fan from the first one covers, as any convex one, becomes that fan. From others ears are cut
[Meisters 1975], in the plane that they lie in as well as they can.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

FLAT = 1e-9  # of a polygon's area: a triangle of a fan may be turned over by so little


@dataclass(frozen=True)
class Triangles:
    """Triangles in the order of the polygons that they come from.

    faces: indices of vertices.
    corner: places in the list of all polygons' corners, one polygon after the other.
    polygon: of each triangle.
    repeated: how many polygons were left out, since an earlier one has the same vertices.
    """

    faces: Int[np.ndarray, "f 3"]
    corner: Int[np.ndarray, "f 3"]
    polygon: Int[np.ndarray, " f"]
    repeated: int


def triangulate(vertices: Float[np.ndarray, "n 3"], polygons: Sequence[Sequence[int]]) -> Triangles:
    """Return the triangles of polygons, of three corners or more; of those with the same vertices the first counts.

    A polygon may come back to a vertex, as along the bridge to a hole; a triangle has three different ones.
    """
    lengths = np.array([len(polygon) for polygon in polygons], np.int64)
    vertex = np.array([k for polygon in polygons for k in polygon], np.int64)
    start = np.cumsum(lengths) - lengths
    corner, polygon, repeated = [np.empty((0, 3), np.int64)], [np.empty(0, np.int64)], 0
    for count in np.unique(lengths):
        same = np.flatnonzero(lengths == count)
        places = start[same, None] + np.arange(count)  # (g, c)
        _, first = np.unique(np.sort(vertex[places], axis=1), axis=0, return_index=True)
        repeated += len(same) - len(first)
        first.sort()
        same, places = same[first], places[first]
        fan = np.stack([np.zeros(count - 2, int), np.arange(1, count - 1), np.arange(2, count)], axis=1)
        cut = np.repeat(fan[None], len(same), axis=0)  # (g, c - 2, 3)
        points = vertices[vertex[places]]
        for k in np.flatnonzero(~_fan_covers(points)) if count > 3 else ():
            cut[k] = _ears(_in_plane(points[k]))
        corner.append((start[same, None, None] + cut).reshape(-1, 3))
        polygon.append(np.repeat(same, count - 2))
    corner, polygon = np.concatenate(corner), np.concatenate(polygon)
    faces = vertex[corner]
    different = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    order = np.argsort(polygon, kind="stable")
    order = order[different[order]]
    return Triangles(faces[order], corner[order], polygon[order], repeated)


def _fan_covers(points: Float[np.ndarray, "g c 3"]) -> Bool[np.ndarray, " g"]:
    """Return for which polygons no triangle of the fan from the first corner is turned over."""
    spokes = points[:, 1:] - points[:, :1]
    doubled = np.cross(spokes[:, :-1], spokes[:, 1:])
    whole = doubled.sum(axis=1, keepdims=True)
    return ((doubled * whole).sum(axis=2) >= -FLAT * (whole**2).sum(axis=2)).all(axis=1)


def _in_plane(points: Float[np.ndarray, "c 3"]) -> Float[np.ndarray, "c 2"]:
    """Return a polygon seen along the axis that it lies across most, anticlockwise."""
    spokes = points - points[0]
    normal = np.cross(spokes[:-1], spokes[1:]).sum(axis=0)
    axis = int(np.abs(normal).argmax())
    flat = spokes[:, [(axis + 1) % 3, (axis + 2) % 3]]
    return flat if normal[axis] > 0 else flat[:, ::-1]


def _ears(flat: Float[np.ndarray, "c 2"]) -> list[tuple[int, int, int]]:
    """Return triangles of corners of an anticlockwise polygon: one ear after the other is cut off."""
    left, found = list(range(len(flat))), []
    while len(left) > 3:
        ear = _ear(flat[left])
        found.append((left[ear - 1], left[ear], left[(ear + 1) % len(left)]))
        del left[ear]
    return [*found, tuple(left)]


def _ear(points: Float[np.ndarray, "c 2"]) -> int:
    """Return the corner nearest to a right angle whose triangle holds no other; the nearest of all if there is none."""
    before, after = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
    turn = _cross(points - before, after - points)
    lengths = np.linalg.norm(points - before, axis=1) * np.linalg.norm(after - points, axis=1)
    sine = np.divide(turn, lengths, out=np.zeros_like(turn), where=lengths > 0)
    hollow = points[sine <= 0]  # one of these is inside if any corner is
    order = np.argsort(-sine, kind="stable")
    for k in order[sine[order] > 0]:
        triangle = (before[k], points[k], after[k])
        inside = np.ones(len(hollow), bool)
        for a, b in zip(triangle, (*triangle[1:], triangle[0]), strict=True):
            inside &= (_cross(b - a, hollow - a) >= 0) & (hollow != a).any(axis=1)
        if not inside.any():
            return int(k)
    return int(order[0])


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
