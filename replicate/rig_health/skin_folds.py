"""The skin in a pose: is it torn, does it fold over, does it fly away; whatever the head as a whole does.

A triangle is *flipped* when its normal points more than 90° away from the mean normal, weighted by area, of the
triangles around it (those that share a vertex), and does not in the neutral pose. So neither a turned jaw nor a bent or
twisted head counts, and neither do corners that are sharp at rest. Of a patch that folds over as a whole, its rim
counts and its middle does not.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse

from replicate.geometry.mesh import Mesh
from replicate.geometry.normals import face_vectors

INSIDE = ("tooth", "teeth", "gum", "tongue", "mouth", "lid")  # segments that begin so are no skin


@dataclass(frozen=True)
class Skin:
    """A mesh's skin: its triangles (f, 3), and which of them are at rest what would count as flipped."""

    mesh: Mesh

    @cached_property
    def face_indices(self) -> Int[np.ndarray, " f"]:
        """The indices of the skin's triangles among the mesh's."""
        skin = [not name.startswith(INSIDE) for name in self.mesh.segment_names]
        return np.flatnonzero(np.array(skin)[self.mesh.segment[self.mesh.faces]].all(1))

    @cached_property
    def faces(self) -> Int[np.ndarray, "f 3"]:
        """The skin's triangles."""
        return self.mesh.faces[self.face_indices]

    @cached_property
    def _around(self) -> sparse.csr_matrix:
        """The triangles about each triangle: (f, f), 1 for a shared vertex, 2 for a shared edge, 0 for itself."""
        f = len(self.faces)
        corner = sparse.csr_matrix((np.ones(3 * f, np.float32), (np.repeat(np.arange(f), 3), self.faces.ravel())))
        around = (corner @ corner.T).tolil()
        around.setdiag(0)
        return around.tocsr()

    @cached_property
    def _sharp(self) -> Bool[np.ndarray, " f"]:
        return self._is_against_mean(self.mesh.neutral[None])[0]

    def _is_against_mean(self, vertices: np.ndarray) -> Bool[np.ndarray, "b f"]:
        vectors = face_vectors(vertices, self.faces)
        f = len(self.faces)
        mean = self._around @ np.ascontiguousarray(vectors.transpose(1, 0, 2)).reshape(f, -1)
        return (mean.reshape(f, -1, 3).transpose(1, 0, 2) * vectors).sum(-1) < 0

    def flipped(self, vertices: Float[np.ndarray, "b n 3"]) -> Bool[np.ndarray, "b f"]:
        """Return which of the skin's triangles are flipped in each pose."""
        return self._is_against_mean(vertices) & ~self._sharp

    def furthest(self, vertices: Float[np.ndarray, "b n 3"]) -> Float[np.ndarray, " b"]:
        """Return how far the furthest vertex is from the neutral's middle, in sizes of the head: 1 is the neutral's."""
        centre = self.mesh.neutral.mean(0)
        size = np.linalg.norm(self.mesh.neutral - centre, axis=1).max()
        return np.linalg.norm(vertices - centre, axis=-1).max(-1) / size
