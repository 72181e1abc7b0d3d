"""Where points and rays meet a surface of triangles: compiled loops over all triangles, most of them passed by quickly.

Each triangle lies in a ball about its centroid; one whose ball is further than the nearest found so far, or that the
ray's line misses, is left out. Everything is double precision and in mm.
"""

from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float
from numba import njit

SAME = 1e-9  # of the squared distance: an edge's or a corner's triangles are equally near


def signed_distances(points: Float[np.ndarray, "k 3"], corners: Float[np.ndarray, "f 3 3"]) -> Float[np.ndarray, " k"]:
    """Return each point's distance to the nearest triangle, negative behind it (normals counter-clockwise).

    Of triangles that share the nearest edge or corner, the one that the point sees most squarely has the say.
    """
    return _signed(np.ascontiguousarray(points, np.float64), *_balls(corners))


def ray_hits(
    origins: Float[np.ndarray, "k 3"],
    directions: Float[np.ndarray, "k 3"],
    corners: Float[np.ndarray, "f 3 3"],
    wanted: Bool[np.ndarray, " f"] | None = None,
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Return where the segments origin + s·direction, 0 ≤ s ≤ 1, first meet a triangle: s, and the cosine there.

    s is infinite for none. The cosine is that between the triangle's normal and the direction. Triangles that are not
    wanted let the rays through.
    """
    wanted = np.ones(len(corners), bool) if wanted is None else wanted
    arrays = (np.ascontiguousarray(array, np.float64) for array in (origins, directions))
    return _first(*arrays, *_balls(corners[wanted]))


def _balls(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return corners, unit normals, centroids and radii."""
    corners = np.ascontiguousarray(corners, np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    centre = corners.mean(1)
    return corners, normal, centre, np.sqrt(((corners - centre[:, None]) ** 2).sum(-1).max(1))


@njit(inline="always", error_model="numpy")
@no_type_check
def _weights(d1, d2, d3, d4, d5, d6):
    """Return the nearest point's weights of b and c, from a point's products with the edges ab and ac as seen from a
    (d1, d2), b (d3, d4) and c (d5, d6); Ericson, Real-Time Collision Detection, 5.1.5.
    """
    if d1 <= 0 and d2 <= 0:
        return 0.0, 0.0
    if d3 >= 0 and d4 <= d3:
        return 1.0, 0.0
    if d6 >= 0 and d5 <= d6:
        return 0.0, 1.0
    vc = d1 * d4 - d3 * d2
    if vc <= 0 and d1 >= 0 and d3 <= 0:
        return d1 / (d1 - d3), 0.0
    vb = d5 * d2 - d1 * d6
    if vb <= 0 and d2 >= 0 and d6 <= 0:
        return 0.0, d2 / (d2 - d6)
    va = d3 * d6 - d5 * d4
    if va <= 0 and d4 - d3 >= 0 and d5 - d6 >= 0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return 1.0 - w, w
    return vb / (va + vb + vc), vc / (va + vb + vc)


@njit(inline="always", error_model="numpy")
@no_type_check
def _towards_nearest(p, corner):
    """Return the vector from the nearest point of a triangle to p, as three numbers: arrays would cost more."""
    ax, ay, az = corner[0, 0], corner[0, 1], corner[0, 2]
    bx, by, bz = corner[1, 0] - ax, corner[1, 1] - ay, corner[1, 2] - az
    cx, cy, cz = corner[2, 0] - ax, corner[2, 1] - ay, corner[2, 2] - az
    x, y, z = p[0] - ax, p[1] - ay, p[2] - az
    bb, bc, cc = bx * bx + by * by + bz * bz, bx * cx + by * cy + bz * cz, cx * cx + cy * cy + cz * cz
    d1, d2 = bx * x + by * y + bz * z, cx * x + cy * y + cz * z
    wb, wc = _weights(d1, d2, d1 - bb, d2 - bc, d1 - bc, d2 - cc)
    return x - wb * bx - wc * cx, y - wb * by - wc * cy, z - wb * bz - wc * cz


@njit(error_model="numpy")
@no_type_check
def _signed(points, corners, normals, centres, radii):
    found = np.empty(len(points))
    for i in range(len(points)):
        p = points[i]
        bound = np.inf  # the nearest point is no further than the far side of the nearest ball
        for j in range(len(corners)):
            x, y, z = p[0] - centres[j, 0], p[1] - centres[j, 1], p[2] - centres[j, 2]
            squared = x * x + y * y + z * z
            if squared < bound * bound:
                bound = min(bound, np.sqrt(squared) + radii[j])
        best, reach, cosine = np.inf, bound, 0.0
        for j in range(len(corners)):
            x, y, z = p[0] - centres[j, 0], p[1] - centres[j, 1], p[2] - centres[j, 2]
            far = reach + radii[j]
            if x * x + y * y + z * z > far * far:
                continue
            x, y, z = _towards_nearest(p, corners[j])
            squared = x * x + y * y + z * z
            if squared > best * (1 + SAME):
                continue
            side = (x * normals[j, 0] + y * normals[j, 1] + z * normals[j, 2]) / max(np.sqrt(squared), 1e-12)
            if squared < best * (1 - SAME) or abs(side) > abs(cosine):
                cosine = side
            best = min(best, squared)
            reach = np.sqrt(best * (1 + SAME)) + 1e-12
        found[i] = np.sqrt(best) if cosine >= 0 else -np.sqrt(best)
    return found


@njit(error_model="numpy")
@no_type_check
def _first(origins, directions, corners, normals, centres, radii):
    found, cosines = np.full(len(origins), np.inf), np.zeros(len(origins))
    for i in range(len(origins)):
        o, d = origins[i], directions[i]
        length = np.sqrt((d * d).sum())
        for j in range(len(corners)):
            x, y, z = centres[j, 0] - o[0], centres[j, 1] - o[1], centres[j, 2] - o[2]
            along = (x * d[0] + y * d[1] + z * d[2]) / length
            if along < -radii[j] or along > length + radii[j]:
                continue
            if x * x + y * y + z * z - along * along > radii[j] * radii[j]:
                continue
            cosine = (normals[j, 0] * d[0] + normals[j, 1] * d[1] + normals[j, 2] * d[2]) / length
            if cosine == 0:
                continue
            a, b, c = corners[j, 0], corners[j, 1], corners[j, 2]
            s = ((a - o) * normals[j]).sum() / (cosine * length)
            if s < 0 or s > 1 or s >= found[i]:
                continue
            q = o + s * d
            inside = True
            for first, second in ((a, b), (b, c), (c, a)):
                edge, towards = second - first, q - first
                turn = (
                    (edge[1] * towards[2] - edge[2] * towards[1]) * normals[j, 0]
                    + (edge[2] * towards[0] - edge[0] * towards[2]) * normals[j, 1]
                    + (edge[0] * towards[1] - edge[1] * towards[0]) * normals[j, 2]
                )
                if turn < -1e-12:
                    inside = False
            if inside:
                found[i], cosines[i] = s, cosine
    return found, cosines
