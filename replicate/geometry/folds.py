"""How a surface folds at its edges: signed angles, and which pose folds a patch most."""

import numpy as np
from jaxtyping import Bool, Float, Int

from replicate.base.exceptions import InputError
from replicate.geometry.mesh import Mesh, face_normals, inner_edges


def fold_angles(
    vertices: Float[np.ndarray, "*b n 3"], faces: Int[np.ndarray, "f 3"], edges: Int[np.ndarray, "e 2"],
    sides: Int[np.ndarray, "e 2"],
) -> Float[np.ndarray, "*b e"]:  # fmt: skip
    """Return the signed angle between the two faces of each inner edge in degrees; 0 is flat, ridges are positive."""
    normals = face_normals(vertices, faces)
    first, second = normals[..., sides[:, 0], :], normals[..., sides[:, 1], :]
    along = vertices[..., edges[:, 1], :] - vertices[..., edges[:, 0], :]
    along = along / np.linalg.norm(along, axis=-1, keepdims=True).clip(1e-12)
    sine = (np.cross(first, second) * along).sum(-1)
    return np.degrees(np.arctan2(sine, (first * second).sum(-1)))


def most_folded(
    mesh: Mesh, poses: Int[np.ndarray, " p"], offsets: Float[np.ndarray, "t n 3"], visible: Bool[np.ndarray, " f"],
    batch: int = 32,
) -> int:  # fmt: skip
    """Return the pose that folds the visible faces most.

    poses: indices of the poses to choose from.
    offsets: V − V⁰ of all poses in mm; may be a memory map.
    visible: which faces count.
    batch: poses at a time.

    The measure is how much the folds at edges between visible faces differ from those in the neutral pose: the mean
    over the edges, weighted by their neutral lengths. Moving or turning the face doesn't change it. Of equal poses the
    first is taken. Raises InputError if no two visible faces share an edge.
    """
    edges, sides = inner_edges(mesh.faces)
    inner = visible[sides].all(-1)
    if not inner.any():
        raise InputError("most_folded: no two of the shown faces share an edge: expected a patch of the mesh")
    edges, sides = edges[inner], sides[inner]
    # only the patch, so that whole heads need not be read into memory
    used, inverse = np.unique(mesh.faces[sides].reshape(-1), return_inverse=True)
    place, face_pairs = np.full(len(mesh.neutral), -1), np.arange(2 * len(sides)).reshape(-1, 2)
    place[used] = np.arange(len(used))
    patch, edges = inverse.reshape(-1, 3), place[edges]
    neutral = mesh.neutral[used]
    rest = fold_angles(neutral, patch, edges, face_pairs)
    length = np.linalg.norm(neutral[edges[:, 1]] - neutral[edges[:, 0]], axis=-1)
    folding = []
    for start in range(0, len(poses), batch):
        posed = neutral + np.stack([np.asarray(offsets[pose])[used] for pose in poses[start : start + batch]])
        change = np.abs(fold_angles(posed.astype(np.float32), patch, edges, face_pairs) - rest)
        folding.append((np.minimum(change, 360 - change) * length).sum(-1) / length.sum())
    return int(poses[np.argmax(np.concatenate(folding))])
