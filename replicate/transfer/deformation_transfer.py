"""Deformation transfer (Sumner and Popović 2004), the classical way to move one mesh as another one does: the baseline.

Every triangle of the new mesh should turn, stretch and shear as its counterpart on the posed original. The vertices
that come nearest to that solve a linear system, whose matrix never changes. Unlike the networks' maps it needs the
original mesh in every pose, and a counterpart for every triangle.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Float32, Float64, Int
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import factorized

from replicate.base.exceptions import InputError
from replicate.geometry.mesh import face_vectors
from replicate.transfer.surface_places import Nearby, nearest_faces


class DeformationTransfer:
    """A new mesh that follows a posed original; its linear system is factored once.

    As in their paper a fourth vertex for each triangle, off its plane, makes the gradient of the deformation a linear
    function of positions (their Eq. 3 to 6). Triangles are weighted by their area here, as in a finite-element sum, so
    that slivers don't decide.

    neutral: vertices of the original in its neutral pose
    source_faces: of the original
    target: vertices of the new mesh in its neutral pose
    faces: of the new mesh
    counterpart: (g,), the face of the original that each new one follows
    """

    def __init__(
        self,
        neutral: Float[np.ndarray, "n 3"],
        source_faces: Int[np.ndarray, "f 3"],
        target: Float[np.ndarray, "k 3"],
        faces: Int[np.ndarray, "g 3"],
        counterpart: Int[np.ndarray, " c"],
    ):
        if len(counterpart) != len(faces):
            raise InputError(
                f"counterparts: expected one for each of the new mesh's {len(faces)} faces, got {len(counterpart)}."
            )
        self.source_faces, self.counterpart, self.count = source_faces, counterpart, len(target)
        self.rest = np.linalg.inv(frames(neutral.astype(np.float64), source_faces))  # (f, 3, 3)
        target = target.astype(np.float64)
        root = np.sqrt(np.linalg.norm(face_vectors(target, faces), axis=1))
        self.weight = np.repeat(root, 3)[:, None]
        matrix = self.weight * _gradient_matrix(target, faces)
        held, self.part, self.parts = _parts(faces, len(target))
        self.free = np.delete(np.arange(matrix.shape[1]), held)
        self.matrix = csr_array(matrix)[:, self.free]
        self.solve = factorized((self.matrix.T @ self.matrix).tocsc())

    def __call__(
        self, posed: Float[np.ndarray, "b n 3"], expected: Float[np.ndarray, "b k 3"]
    ) -> Float32[np.ndarray, "b k 3"]:
        """Return the new mesh's vertices, mm, for poses of the original.

        expected: roughly where the vertices are. Gradients don't determine translations, so the mean of each connected
        part is put on that of its expected vertices.
        """
        edges = frames(posed.astype(np.float64), self.source_faces[self.counterpart])
        gradients = self.rest[self.counterpart] @ edges  # (b, g, 3, 3), x → x @ gradient
        b = len(posed)
        wanted = self.weight * gradients.reshape(b, -1, 3).transpose(1, 0, 2).reshape(-1, 3 * b)
        vertices = np.zeros((len(self.free) + self.parts, 3 * b))
        vertices[self.free] = self.solve(self.matrix.T @ wanted)
        vertices = vertices[: self.count].reshape(self.count, b, 3).transpose(1, 0, 2)
        sizes = np.bincount(self.part, minlength=self.parts)
        mean = csr_array((1 / sizes[self.part], (self.part, np.arange(self.count))), shape=(self.parts, self.count))
        for pose, aim in zip(vertices, expected, strict=True):
            pose += (mean @ (aim - pose))[self.part]
        return vertices.astype(np.float32)


def frames(vertices: Float64[np.ndarray, "*b n 3"], faces: Int[np.ndarray, "f 3"]) -> Float64[np.ndarray, "*b f 3 3"]:
    """Return two edges of each triangle and a vector along its normal, of about their length, as rows."""
    normals = face_vectors(vertices, faces)
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    a, b, c = (np.take(vertices, faces[:, corner], axis=-2) for corner in range(3))
    return np.stack([b - a, c - a, normals / np.sqrt(np.maximum(length, 1e-12))], axis=-2)


def counterparts(
    target: Float[np.ndarray, "k 3"],
    faces: Int[np.ndarray, "g 3"],
    neutral: Float[np.ndarray, "n 3"],
    source_faces: Int[np.ndarray, "f 3"],
    nearby: Nearby | None = None,
) -> Int[np.ndarray, " g"]:
    """Return the original's face nearest to the middle of each new one, among those that face the same way.

    For meshes of the same neutral surface that is exact enough; others have to be aligned by landmarks first.

    target: vertices of the new mesh
    faces: of the new mesh
    neutral: vertices of the original
    source_faces: of the original
    nearby: for the new vertices, the parts of the original's surface that they belong to
    """
    of_middles = None if nearby is None else replace(nearby, points=nearby.points[faces].mean(1))
    return nearest_faces(target[faces].mean(1), neutral, source_faces, face_vectors(target, faces), nearby=of_middles)


def _gradient_matrix(target: np.ndarray, faces: np.ndarray) -> csr_array:
    """Return (3g, k + g): vertices and fourth vertices → the gradients of all triangles, one below the other."""
    inverse = np.linalg.inv(frames(target, faces))  # (g, 3, 3): gradient = inverse @ posed frame
    count = len(faces)
    rows = np.arange(3 * count).reshape(count, 3)
    fourth = len(target) + np.arange(count)
    columns = np.concatenate([faces, fourth[:, None]], axis=1)  # first, second, third, fourth vertex
    entries = np.concatenate([-inverse.sum(2, keepdims=True), inverse], axis=2)  # (g, 3, 4)
    places = np.broadcast_to(rows[:, :, None], entries.shape), np.broadcast_to(columns[:, None], entries.shape)
    shape = (3 * count, len(target) + count)
    return coo_array((entries.ravel(), tuple(place.ravel() for place in places)), shape=shape).tocsr()


def _parts(faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Return one vertex of each connected part, the part of each vertex, and how many parts there are."""
    a, b = faces[:, [0, 1]].T.ravel(), faces[:, [1, 2]].T.ravel()
    joined = coo_array((np.ones(len(a)), (a, b)), shape=(count, count))
    parts, part = connected_components(joined, directed=False)
    return np.unique(part, return_index=True)[1], part, parts
