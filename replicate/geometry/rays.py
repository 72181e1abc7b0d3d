"""Where rays meet a surface of triangles: a compiled loop over all triangles, which skips most of them quickly.

Each triangle lies in a ball around its centroid; if a ray misses the ball, the triangle is skipped. Everything is in
double precision and in mm.
"""

from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float
from numba import njit

from replicate.base.jit_cache import kept


def ray_hits(
    origins: Float[np.ndarray, "k 3"],
    directions: Float[np.ndarray, "k 3"],
    corners: Float[np.ndarray, "f 3 3"],
    opaque: Bool[np.ndarray, " f"] | None = None,
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Return where the lines origin + s·direction, 0 ≤ s ≤ 1, first meet a triangle: s, and a cosine.

    opaque: which triangles stop a ray, all by default.

    s is infinite if no triangle is met. The cosine is that between the triangle's normal and the direction.
    """
    opaque = np.ones(len(corners), bool) if opaque is None else opaque
    arrays = (np.ascontiguousarray(array, np.float64) for array in (origins, directions))
    return _first(*arrays, *_balls(corners[opaque]))


def _balls(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return corners, unit normals, centroids and radii."""
    corners = np.ascontiguousarray(corners, np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    centre = corners.mean(1)
    return corners, normal, centre, np.sqrt(((corners - centre[:, None]) ** 2).sum(-1).max(1))


@kept
@njit(error_model="numpy")
@no_type_check
def _first(origins, directions, corners, normals, centres, radii):
    nearest, cosines = np.full(len(origins), np.inf), np.zeros(len(origins))
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
            if s < 0 or s > 1 or s >= nearest[i]:
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
                nearest[i], cosines[i] = s, cosine
    return nearest, cosines
