"""Which control can move which vertex: the inputs of each segment's networks (§3.1).

In the paper, a segment's network sees the rig parameters that can move the segment. For a closed rig only trials show
which these are. One trial at the default pose is not enough: a wrinkle gain does nothing on a smooth forehead, sticky
lips do nothing in a closed mouth. So every control is moved to both ends of its range from several poses.
"""

from collections.abc import Callable
from contextlib import nullcontext

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int

from data_recipes.rig import Rig
from replicate.approximation.samples import SampleSet, evaluate
from replicate.approximation.sampling import augment

THRESHOLD_MM = 1e-3  # a tenth of the last digit in Table 2, and well above float32 rounding


def influence_poses(
    rig: Rig, poses: Float[np.ndarray, "a m"], generator: np.random.Generator, count: int = 12
) -> Float32[np.ndarray, "count m"]:
    """Choose poses to try controls from: the default pose, training poses far apart, and Eq. 5 on those."""
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
    rig: Rig, poses: Float[np.ndarray, "b m"], threshold_mm: float = THRESHOLD_MM, progress: Callable | None = None
) -> Bool[np.ndarray, "n m"]:
    """Return which control moves which vertex by more than `threshold_mm` along an axis, from any of the poses.

    poses: as `influence_poses` chooses them. From each of them, every control is set to both ends of its range.
    progress: as for `write_samples`.
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


# Where no control can be tried, influence is estimated from training poses (DEVIATIONS D7): by ridge regression on the
# controls and on *shadows*, which are columns of controls in shuffled order, so that all their effect is noise.

POSES = 10_000  # at most
BATCH = 128
RIDGE = 1e-4  # in mean squares of a column, which are 1
FLOOR_MM = 0.005
SHADOWS = 64  # at most: a shadow for each control would be too much for few samples
TIMES = 1.5  # a control moves a vertex if its effect is that of the largest shadow times this, or more


def estimate_influence(
    samples: SampleSet,
    default: Float[np.ndarray, " m"],
    generator: np.random.Generator,
    progress: Callable | None = None,
) -> Bool[np.ndarray, "n m"]:
    """Return which control moves which vertex, estimated from the training samples.

    default: the controls' defaults.
    generator: shuffles the shadows.
    progress: as for `write_samples`.
    """
    effects, shadows = effects_mm(samples, default, generator, progress)
    noise = shadows.max(axis=1, keepdims=True)
    return effects > np.maximum(FLOOR_MM, TIMES * noise)


def effects_mm(
    samples: SampleSet,
    default: Float[np.ndarray, " m"],
    generator: np.random.Generator,
    progress: Callable | None = None,
) -> tuple[Float64[np.ndarray, "n m"], Float64[np.ndarray, "n s"]]:
    """Return how far each control moves each vertex, and how far each shadow seems to, in mm (root mean squares)."""
    poses = np.unique(np.linspace(0, len(samples) - 1, POSES).astype(int))
    moves = np.asarray(samples.params[poses], np.float64) - default
    m = moves.shape[1]
    shadowed = np.sort(generator.choice(m, min(m, SHADOWS), replace=False))
    both = np.concatenate([moves, moves[generator.permutation(len(moves))][:, shadowed]], axis=1)
    count = both.shape[1]
    columns = np.concatenate([both, both**2], axis=1)  # p, shadows of p, p², shadows of p²
    size = np.sqrt((columns**2).mean(axis=0))
    columns /= np.where(size > 0, size, 1.0)
    design = np.concatenate([columns, np.ones((len(columns), 1))], axis=1).astype(np.float32)
    products = np.zeros((design.shape[1], samples.quantised.shape[1] * 3), np.float32)
    with progress(len(poses), "influence", 0) if progress else nullcontext() as bar:
        for first in range(0, len(poses), BATCH):
            rows = poses[first : first + BATCH]
            products += design[first : first + BATCH].T @ samples.offsets(rows).reshape(len(rows), -1)
            if bar is not None:
                bar.update(len(rows))
    gram = design.T.astype(np.float64) @ design
    weights = np.linalg.solve(gram + RIDGE * len(poses) * np.eye(len(gram)), products.astype(np.float64))
    weights = weights[:-1].reshape(2, count, -1, 3)  # (term, control or shadow, vertex, axis)
    mixed = (columns[:, :count] * columns[:, count:]).mean(axis=0)[:, None]  # correlation of a control and its square
    used = (size[:count] > 0)[:, None]
    square = (weights[0] ** 2).sum(-1) + (weights[1] ** 2).sum(-1) + 2 * mixed * (weights[0] * weights[1]).sum(-1)
    effects = np.sqrt(np.maximum(square, 0.0)) * used
    return effects[:m].T, effects[m:].T
