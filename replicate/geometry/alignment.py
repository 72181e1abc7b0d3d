"""The rotation and translation that best align two point sets (Eq. 3); rotations act on row vectors, V @ R + t."""

import numpy as np
from jaxtyping import Float


def align(
    source: Float[np.ndarray, "*#batch n 3"], target: Float[np.ndarray, "*#batch n 3"]
) -> tuple[Float[np.ndarray, "*batch 3 3"], Float[np.ndarray, "*batch 3"]]:
    """Return the rotation R and translation t that best align two point sets (Eq. 3).

    They minimise Σ_i ‖source_i R + t − target_i‖² with R in SO(3): a mirrored or flat target gives the best proper
    rotation, never a reflection. If points on a line or in one place leave a choice, the rotation nearest to the
    identity is taken. Leading axes are batches and broadcast. All is computed in float64.
    """
    source, target = np.asarray(source, np.float64), np.asarray(target, np.float64)
    source_centre, target_centre = source.mean(-2, keepdims=True), target.mean(-2, keepdims=True)
    rotation = nearest_rotation(np.swapaxes(source - source_centre, -1, -2) @ (target - target_centre))
    return rotation, (target_centre - source_centre @ rotation)[..., 0, :]


def nearest_rotation(matrix: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Return the R in SO(3) that maximises tr(Rᵀ matrix).

    A rank-deficient matrix leaves R undetermined; 1e-12 of its size is added along the identity to settle that.
    """
    size = np.linalg.norm(matrix, axis=(-2, -1), keepdims=True)
    regular = matrix + (1e-12 * size + np.finfo(np.float64).tiny) * np.eye(3)
    left, _, right = np.linalg.svd(regular)
    sign = np.ones(left.shape[:-1])
    sign[..., 2] = np.where(np.linalg.det(left) * np.linalg.det(right) < 0, -1.0, 1.0)
    return (left * sign[..., None, :]) @ right
