"""Which control can move which vertex, where no control can be tried: estimated from training poses (DEVIATIONS D7).

A ridge regression of all offsets on every control and its square says how far each control moves each vertex: the root
mean square of its two terms over the poses. What such a regression makes of nothing is measured along with it: some
controls have a shadow, their own values in other poses, whose effects are noise. A control moves a vertex if its effect
there is larger than TIMES those of all shadows, and than a floor. Whatever controls only do together, which a sum of
single effects doesn't hold, counts as that noise: so an estimate misses weak effects of controls that act in few poses.
Frames of clips don't take part: neighbours in time are alike, and their shadows aren't, so that noise would pass for
influence.
"""

from collections.abc import Callable
from contextlib import nullcontext

import numpy as np
from jaxtyping import Bool, Float, Float64

from replicate.approximation.samples import SampleSet

POSES = 10_000  # most that are looked at
BATCH = 128
RIDGE = 1e-4  # of the mean square of a column, which is 1
FLOOR_MM = 0.005
SHADOWS = 64  # at most; as many columns of noise as of controls would take too much from few samples
TIMES = 1.5


def estimate_influence(
    samples: SampleSet,
    default: Float[np.ndarray, " m"],
    generator: np.random.Generator,
    progress: Callable | None = None,
) -> Bool[np.ndarray, "n m"]:
    """Return which control moves which vertex, by the training samples.

    default: the controls' defaults. generator: orders the shadows' poses. progress: as for `write_samples`.
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
    """Return how far each control moves each vertex, and how far shadows seem to, in mm (root mean squares)."""
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
    mixed = (columns[:, :count] * columns[:, count:]).mean(axis=0)[:, None]  # of a control and its square
    used = (size[:count] > 0)[:, None]
    square = (weights[0] ** 2).sum(-1) + (weights[1] ** 2).sum(-1) + 2 * mixed * (weights[0] * weights[1]).sum(-1)
    effects = np.sqrt(np.maximum(square, 0.0)) * used
    return effects[:m].T, effects[m:].T
