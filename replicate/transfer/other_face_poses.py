"""Every way to move another character's face by poses of the original; offsets are scaled to its size."""

import numpy as np

from replicate.approximation.model import SegmentedModel
from replicate.approximation.refinement import RefinedModel
from replicate.geometry.mesh import Mesh
from replicate.transfer.deformation_transfer import DeformationTransfer
from replicate.transfer.face_surface import face_of
from replicate.transfer.landmark_alignment import AlignedFace
from replicate.transfer.new_mesh_poses import SourcePoses, Way
from replicate.transfer.transferred_model import transferred


def ways_onto(mesh: Mesh, face: AlignedFace, coarse: SegmentedModel, refined: RefinedModel) -> dict[str, Way]:
    """Return what moves another face, by the names of `new_mesh_poses.WAYS`: poses of the original → (b, k, 3) mm.

    mesh: the original. Offsets are millimetres of the original's face, along its axes, and are multiplied by
    `face.scale`. Deformation transfer takes gradients instead, which have no size; its mean alone goes where the scaled
    offsets lead. Otherwise as `new_mesh_poses.ways_to_move` says.
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
