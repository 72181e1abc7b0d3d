"""Edges as ribbons over a surface, so that every renderer draws them; quads where triangles are halves of quads."""

import numpy as np
from jaxtyping import Float, Int

from replicate.drawing.scene import Camera, Surface, axes
from replicate.geometry.normals import face_normals

INK = (66, 69, 76)
LIFT_MM = 0.35  # towards the eye, so that the surface doesn't cut the ribbons


def quad_edges(faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "e 2"]:
    """Return a mesh's edges, (e, 2) vertices, each once; without diagonals where its triangles are halves of quads.

    Our rigs list the first halves (a, b, c) of all quads and then the second halves (a, c, d). Of any other mesh all
    edges are returned.
    """
    half = len(faces) // 2
    first, second = faces[:half], faces[half:]
    halves = len(first) == len(second) and (first[:, [0, 2]] == second[:, [0, 1]]).all()
    if halves:
        directed = np.concatenate([first[:, [0, 1]], first[:, [1, 2]], second[:, [1, 2]], second[:, [2, 0]]])
    else:
        directed = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    return np.unique(np.sort(directed, axis=1), axis=0).astype(np.int32)


def wireframe(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "f 3"], camera: Camera, width_mm: float = 0.28
) -> Surface:
    """Return a surface's edges as flat ribbons turned to the camera; edges on its far side are left out."""
    v = np.asarray(vertices, float)
    to_eye = axes(camera)[1] - v
    to_eye /= np.linalg.norm(to_eye, axis=1, keepdims=True)
    visible = np.zeros(len(v), bool)
    visible[faces[(face_normals(v, faces) * to_eye[faces[:, 0]]).sum(-1) > 0]] = True
    edges = quad_edges(faces)
    a, b = edges[visible[edges].all(1)].T
    aside = np.cross(v[b] - v[a], to_eye[a])
    aside *= 0.5 * width_mm / np.linalg.norm(aside, axis=1, keepdims=True).clip(1e-9)
    corners = np.stack([v[a] - aside, v[a] + aside, v[b] + aside, v[b] - aside], 1) + LIFT_MM * to_eye[a][:, None]
    corner = np.arange(4 * len(a)).reshape(-1, 4)
    ribbons = np.concatenate([corner[:, [0, 1, 2]], corner[:, [0, 2, 3]]])
    return Surface(np.float32(corners.reshape(-1, 3)), np.int32(ribbons), INK, lit=False, smooth=False)
