"""A new mesh in some poses: its true vertices, and those of every way to move it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Int

from replicate.approximation.metrics import normal_error, vertex_error
from replicate.approximation.model import SegmentedModel
from replicate.approximation.refinement import RefinedModel
from replicate.geometry.mesh import Mesh
from replicate.transfer.deformation_transfer import DeformationTransfer
from replicate.transfer.landmark_alignment import AlignedFace, face_of
from replicate.transfer.remeshing import NewMesh
from replicate.transfer.transferred_model import transferred

WAYS = ("coarse", "refined", "coarse_carried", "deformation_transfer", "deformation_transfer_coarse", "neutral")


@dataclass(frozen=True)
class SourcePoses:
    """Some poses of the original mesh, from which new meshes are moved.

    params: (b, m) raw rig parameters. truth: (b, n, 3) the rig's vertices, mm, which only `deformation_transfer` uses.
    predicted: (b, n, 3) the coarse model's vertices.
    """

    params: np.ndarray
    truth: np.ndarray
    predicted: np.ndarray


Way = Callable[[SourcePoses], Float[np.ndarray, "b k 3"]]


def ways_to_move(
    mesh: Mesh,
    faces: Int[np.ndarray, "f 3"],
    new: NewMesh,
    counterpart: Int[np.ndarray, " g"],
    coarse: SegmentedModel,
    refined: RefinedModel,
) -> dict[str, Way]:
    """Return what moves a new mesh, by the names of `WAYS`: poses of the original → vertices (b, k, 3), mm.

    `coarse` and `refined` read the maps at the new texture coordinates; "coarse_carried" takes the coarse model's
    prediction for the original mesh to the new vertices' places; both deformation transfers follow the original mesh,
    as the rig has it (an oracle) and as the coarse model does; "neutral" doesn't move.

    mesh: the original
    faces: those of the original that new vertices lie on
    new: the new mesh, and the places of its vertices on the original
    counterpart: the one of `faces` that each new face follows
    coarse: model of the original
    refined: model of the original
    """
    target, places = new.mesh, new.places
    follow = DeformationTransfer(mesh.neutral, faces, target.neutral, target.faces, counterpart)
    on_new = {name: transferred(model, target) for name, model in (("coarse", coarse), ("refined", refined))}
    return {
        "coarse": lambda poses: target.neutral + on_new["coarse"].offsets(poses.params),
        "refined": lambda poses: target.neutral + on_new["refined"].offsets(poses.params),
        "coarse_carried": lambda poses: places.mix(poses.predicted),
        "deformation_transfer": lambda poses: follow(poses.truth, places.mix(poses.truth)),
        "deformation_transfer_coarse": lambda poses: follow(poses.predicted, places.mix(poses.predicted)),
        "neutral": lambda poses: np.broadcast_to(target.neutral, (len(poses.params), *target.neutral.shape)),
    }


def pose_means(
    vertices: Float[np.ndarray, "b k 3"], truth: Float[np.ndarray, "b k 3"], faces: Int[np.ndarray, "g 3"]
) -> Float64[np.ndarray, "b 2"]:
    """Return each pose's mean distance of vertices in mm and mean angle between normals in degrees (Eq. 11).

    Faces without a normal in either are left out.
    """
    distance = vertex_error(vertices, truth).mean(1, dtype=np.float64)
    return np.stack([distance, np.nanmean(normal_error(vertices, truth, faces), axis=1, dtype=np.float64)], axis=1)


def errors_of_ways(ways: Mapping[str, Way], new: NewMesh, poses: SourcePoses) -> dict[str, Float64[np.ndarray, "b 2"]]:
    """Return `pose_means` of every way to move a new mesh; the truth is the rig's surface at the vertices' places."""
    truth = new.places.mix(poses.truth)
    return {name: pose_means(move(poses), truth, new.mesh.faces) for name, move in ways.items()}


# Every way to move another character's face by poses of the original; offsets are scaled to its size.


def ways_onto(mesh: Mesh, face: AlignedFace, coarse: SegmentedModel, refined: RefinedModel) -> dict[str, Way]:
    """Return what moves another face, by the names of `WAYS`: poses of the original → (b, k, 3) mm.

    mesh: the original. Offsets are millimetres of the original's face, along its axes, and are multiplied by
    `face.scale`. Deformation transfer works with gradients, which have no size; the scaled offsets only set its mean.
    For the rest see `ways_to_move`.
    """
    target, places, scale = face.new.mesh, face.new.places, np.float32(face.scale)
    follow = DeformationTransfer(mesh.neutral, face_of(mesh).faces, target.neutral, target.faces, face.counterpart)
    on_new = {name: transferred(model, target) for name, model in (("coarse", coarse), ("refined", refined))}

    def read(name: str, poses: SourcePoses) -> np.ndarray:
        return target.neutral + scale * on_new[name].offsets(poses.params)

    def carried(posed: np.ndarray) -> np.ndarray:
        return target.neutral + scale * places.mix(posed - mesh.neutral)

    return {
        "coarse": lambda poses: read("coarse", poses),
        "refined": lambda poses: read("refined", poses),
        "coarse_carried": lambda poses: carried(poses.predicted),
        "deformation_transfer": lambda poses: follow(poses.truth, carried(poses.truth)),
        "deformation_transfer_coarse": lambda poses: follow(poses.predicted, carried(poses.predicted)),
        "neutral": lambda poses: np.broadcast_to(target.neutral, (len(poses.params), *target.neutral.shape)),
    }
