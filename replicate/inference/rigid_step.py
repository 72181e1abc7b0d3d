"""The rigid step of one pose (§3.4), compiled: the best rotations by quaternions, written over the rigid segments.

`geometry.alignment.align` takes the singular values of a stack of 3×3 matrices; in NumPy one pose of a hundred teeth
costs more than all else. The matrix whose rotation is sought is made regular as there, so that points which leave a
freedom turn the same way.
"""

from typing import NamedTuple, no_type_check

import numpy as np
from numba import njit

from replicate.approximation.rigid import Attachments
from replicate.engine.jit_cache import KEEP_CODE
from replicate.geometry.mesh import Mesh
from replicate.inference.quaternion import best_quaternion

REGULAR = 1e-12  # of a matrix's size along the identity, as in `alignment.nearest_rotation`


class RigidPlan(NamedTuple):
    """r rigid segments, c carriers each: carriers (r, c) of the mesh, their places at rest about their mean (r, c, 3)
    and that mean (r, 3); members (k,) of all segments in turn, their places at rest (k, 3), and ends (r,) of each.
    """

    carriers: np.ndarray
    rest: np.ndarray
    centres: np.ndarray
    members: np.ndarray
    places: np.ndarray
    ends: np.ndarray


def plan_rigid_step(mesh: Mesh, attachments: Attachments) -> RigidPlan:
    """Return what the rigid step of a mesh needs."""
    carriers = np.asarray(attachments.vertex, np.int64)
    rest = mesh.neutral[carriers].astype(np.float64)
    centres = rest.mean(1) if len(carriers) else np.zeros((0, 3))
    members = [np.flatnonzero(mesh.segment == k) for k in attachments.segment]
    all_members = np.concatenate([*members, np.zeros(0, np.int64)])
    ends = np.cumsum([len(own) for own in members], dtype=np.int64)
    places = mesh.neutral[all_members].astype(np.float64)
    return RigidPlan(carriers, rest - centres[:, None], centres, all_members, places, ends)


@njit(cache=KEEP_CODE, error_model="numpy", nogil=True)
@no_type_check
def place_rigid_segments(plan: RigidPlan, posed: np.ndarray) -> None:
    """Write the rigid segments of a posed mesh (n, 3), float32 mm, where their carriers in it have moved to."""
    m, a, vectors = np.empty((3, 3)), np.empty((4, 4)), np.empty((4, 4))
    q, centre = np.empty(4), np.empty(3)
    start = 0
    for row in range(len(plan.ends)):
        count = plan.carriers.shape[1]
        centre[:] = 0.0
        for k in range(count):
            for j in range(3):
                centre[j] += posed[plan.carriers[row, k], j]
        centre /= count
        m[:] = 0.0
        for k in range(count):
            for i in range(3):
                for j in range(3):
                    m[i, j] += plan.rest[row, k, i] * (posed[plan.carriers[row, k], j] - centre[j])
        size = 0.0
        for i in range(3):
            for j in range(3):
                size += m[i, j] * m[i, j]
        if size > 0:
            m /= np.sqrt(size)
        for j in range(3):
            m[j, j] += REGULAR
        best_quaternion(m, a, vectors, q)
        w, x, y, z = q[0], q[1], q[2], q[3]
        xx, yx, zx = w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)
        xy, yy, zy = 2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)
        xz, yz, zz = 2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z
        ox, oy, oz = plan.centres[row, 0], plan.centres[row, 1], plan.centres[row, 2]
        tx = centre[0] - ox * xx - oy * yx - oz * zx
        ty = centre[1] - ox * xy - oy * yy - oz * zy
        tz = centre[2] - ox * xz - oy * yz - oz * zz
        for k in range(start, plan.ends[row]):
            px, py, pz = plan.places[k, 0], plan.places[k, 1], plan.places[k, 2]
            vertex = plan.members[k]
            posed[vertex, 0] = px * xx + py * yx + pz * zx + tx
            posed[vertex, 1] = px * xy + py * yy + pz * zy + ty
            posed[vertex, 2] = px * xz + py * yz + pz * zz + tz
        start = plan.ends[row]
