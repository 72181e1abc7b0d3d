"""Normals of faces and vertices (the n_i of Eq. 1 and Eq. 11), and faces that have none."""

import numpy as np
from jaxtyping import Float, Int

# A face counts as degenerate when its height over its longest edge is below this: float32 millimetres of a head
# carry about 1e-5 mm of rounding, so the normal of such a face would be noise.
FLATNESS = 1e-5


def face_vectors(vertices: Float[np.ndarray, "*b n 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "*b f 3"]:
    """Return twice the area of each face times its normal: the cross product of two edges, not normalised."""
    a, b, c = (np.take(vertices, faces[:, k], axis=-2) for k in range(3))
    b -= a
    c -= a
    out = np.empty_like(b)
    out[..., 0] = b[..., 1] * c[..., 2] - b[..., 2] * c[..., 1]
    out[..., 1] = b[..., 2] * c[..., 0] - b[..., 0] * c[..., 2]
    out[..., 2] = b[..., 0] * c[..., 1] - b[..., 1] * c[..., 0]
    return out


def face_normals(vertices: Float[np.ndarray, "*b n 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "*b f 3"]:
    """Return each face's unit normal (the n_i of Eq. 1 and Eq. 11); a face without an area gets the zero vector."""
    return _normalise(face_vectors(vertices, faces))


def vertex_normals(vertices: Float[np.ndarray, "*b n 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "*b n 3"]:
    """Return each vertex's unit normal: the mean of its faces' normals, weighted by area (for shading only)."""
    vectors = face_vectors(vertices, faces)
    total = np.zeros_like(vertices)
    flat, source = (
        total.reshape(-1, *total.shape[-2:]),
        vectors.reshape(-1, *vectors.shape[-2:]),
    )
    for pose, vector in zip(flat, source, strict=True):
        for corner in range(3):
            for axis in range(3):
                pose[:, axis] += np.bincount(faces[:, corner], vector[:, axis], minlength=pose.shape[0])
    return _normalise(total)


def degenerate_faces(vertices: Float[np.ndarray, "*b n 3"], faces: Int[np.ndarray, "f 3"]) -> np.ndarray:
    """Return (..., f) bool: faces whose height over their longest edge is below `FLATNESS`, or that are points."""
    exact = vertices.astype(np.float64)
    corners = exact[..., faces, :]
    longest = (np.roll(corners, -1, axis=-2) - corners) ** 2
    longest = longest.sum(-1).max(-1)
    double_area = np.linalg.norm(face_vectors(exact, faces), axis=-1)
    return double_area <= FLATNESS * longest


def _normalise(vectors: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)
