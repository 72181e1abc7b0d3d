"""Which control can move which vertex: the inputs of each segment's networks (§3.1).

The paper feeds a segment's network the rig parameters that can move the segment. For a closed rig only trials
show which those are. One trial at the default pose is not enough: a wrinkle gain does nothing on a smooth forehead,
sticky lips nothing in a closed mouth. So every control is moved to both ends of its range from several poses.
"""

from collections.abc import Callable
from contextlib import nullcontext

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from data_recipes.rig import Rig
from replicate.approximation.samples import evaluate
from replicate.approximation.sampling import augment

THRESHOLD_MM = 1e-3  # a tenth of the smallest error in Table 2's last digit, and well above float32 rounding


def influence_poses(
    rig: Rig, poses: Float[np.ndarray, "a m"], generator: np.random.Generator, count: int = 12
) -> Float32[np.ndarray, "count m"]:
    """Choose poses to try controls from: the default, far-apart poses of the animation, and Eq. 5 on those.

    poses: training poses (or uniform ones, for a rig without clips).
    """
    spread = (poses - rig.default) / (rig.upper - rig.lower)
    base = np.asarray(poses, dtype=np.float32)[farthest_first(spread, max(1, (count - 1) // 2))]
    augmentation = augment(base, count - 1 - len(base), generator)
    return np.concatenate([np.asarray(rig.default, dtype=np.float32)[None], base, augmentation])


def farthest_first(points: Float[np.ndarray, "a m"], count: int) -> Int[np.ndarray, " count"]:
    """Pick points greedily, each the farthest from the origin and from all before it."""
    distance = (np.asarray(points, dtype=np.float64) ** 2).sum(axis=1)
    indices = []
    for _ in range(min(count, len(points))):
        indices.append(int(np.argmax(distance)))
        distance = np.minimum(distance, ((points - points[indices[-1]]) ** 2).sum(axis=1))
    return np.array(indices, dtype=np.int64)


def influence(
    rig: Rig,
    poses: Float[np.ndarray, "b m"],
    threshold_mm: float = THRESHOLD_MM,
    progress: Callable | None = None,
) -> Bool[np.ndarray, "n m"]:
    """Return which control moves which vertex by more than `threshold_mm` along an axis, from any of some poses.

    From every pose, each control in turn is set to the lower and to the upper end of its range, the others unchanged:
    1 + 2m rig calls a pose, batched. poses: as `influence_poses` chooses them. progress: as for `write_samples`.
    """
    m = len(rig.controls)
    moves = np.zeros((m, len(rig.mesh.neutral)), dtype=bool)
    target = np.concatenate([rig.lower, rig.upper]).astype(np.float32)
    with progress(len(poses) * (1 + 2 * m), "influence", 0) if progress else nullcontext() as bar:
        for pose in np.asarray(poses, dtype=np.float32):
            trials = np.repeat(pose[None], 1 + 2 * m, axis=0)  # row 0 is the pose itself, row 1 + j moves control j % m
            trials[np.arange(1, 1 + 2 * m), np.tile(np.arange(m), 2)] = target
            for rows, vertices in evaluate(rig, trials):
                if rows.start == 0:
                    base = vertices[0]
                for row, positions in zip(range(rows.start, rows.stop), vertices, strict=True):
                    moves[(row - 1) % m] |= np.abs(positions - base).max(axis=-1) > threshold_mm
                if bar is not None:
                    bar.update(len(vertices))
    return moves.T
