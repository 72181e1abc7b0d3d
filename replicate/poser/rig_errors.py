"""How far a posed face is from the rig's, vertex by vertex: in distance, and in the angle of normals (Eq. 11)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

from replicate.approximation.metrics import normal_error, vertex_error
from replicate.drawing.heatmap import NORMAL_TICKS_DEG, ROOT, error_colours
from replicate.poser.contents import PosedFace
from replicate.poser.face_page import posed_vertices


@dataclass(frozen=True)
class Scale:
    """A colour scale: errors from 0 to `limit`, larger ones have the last colour. ticks: errors with a label."""

    title: str
    unit: str
    limit: float
    ticks: tuple[float, ...]

    def colours(self, errors: Float[np.ndarray, " k"]) -> UInt8[np.ndarray, "k 3"]:
        """Return each error's colour, by its root; NaN is grey."""
        return error_colours(errors, self.limit, ROOT)

    def place(self, error: float) -> float:
        """Return where an error stands on the scale's bar, from 0 to 1."""
        return (error / self.limit) ** ROOT


NORMAL, DISTANCE = "normal", "distance"
SCALES = {
    NORMAL: Scale("normal angle error", "degrees", 30.0, tuple(tick for tick in NORMAL_TICKS_DEG if tick <= 30)),
    DISTANCE: Scale("distance error", "mm", 8.0, (0, 0.1, 0.5, 1, 2, 4, 8)),
}


@dataclass(frozen=True)
class RigErrors:
    """One pose's errors against the rig.

    distance: (n,), mm
    normal: (n,), degrees, the mean angle of each vertex's faces (Eq. 11); NaN where none of them has a normal
    normal_mean: over all faces, degrees, as in the tables
    predicted: the approximation's vertices, (n, 3), mm
    truth: the rig's vertices, (n, 3), mm
    """

    distance: Float[np.ndarray, " n"]
    normal: Float[np.ndarray, " n"]
    normal_mean: float
    predicted: Float32[np.ndarray, "n 3"]
    truth: Float32[np.ndarray, "n 3"]

    def of(self, kind: str) -> Float[np.ndarray, " n"]:
        """Return the errors of a kind, NORMAL or DISTANCE."""
        return {NORMAL: self.normal, DISTANCE: self.distance}[kind]

    def in_words(self) -> str:
        """Return the mean errors, and the largest ones."""
        return (
            f"normals: mean {self.normal_mean:.2f}°, worst vertex {np.nanmax(self.normal):.1f}°; "
            f"distance: mean {self.distance.mean():.2f} mm, worst {self.distance.max():.2f} mm"
        )


def rig_errors(face: PosedFace, params: Float32[np.ndarray, " m"]) -> RigErrors:
    """Return how far a face, posed as in a browser, is from its rig at the same raw parameters."""
    truth = np.asarray(face.rig(params[None])[0], np.float32)
    predicted = posed_vertices(face, params[None])[0]
    faces = face.rig.mesh.faces
    angles = normal_error(predicted, truth, faces)
    mean = float(np.nanmean(angles))
    return RigErrors(vertex_error(predicted, truth), at_vertices(angles, faces, len(truth)), mean, predicted, truth)


def at_vertices(values: Float[np.ndarray, " f"], faces: Int[np.ndarray, "f 3"], count: int) -> Float[np.ndarray, " n"]:
    """Return the mean over each of `count` vertices' faces, leaving out NaN; NaN where no face is left."""
    known = ~np.isnan(values)
    corners = faces[known].ravel()
    total = np.bincount(corners, np.repeat(values[known], 3), count)
    faces_known = np.bincount(corners, minlength=count)
    return np.where(faces_known > 0, total / np.maximum(faces_known, 1), np.nan)
