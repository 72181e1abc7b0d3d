"""How far two controls change what each other does: mixed second differences of the rig.

    d_ij(p) = r(p + a_i + b_j) − r(p + a_i) − r(p + b_j) + r(p)

is zero at a vertex where the rig adds up the effects of i and j, however curved each of them is alone. Steps are as
large as a control usually moves, so that the difference says what a sum of shapes would get wrong in practice.
"""

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64, Int

from data_recipes.rig import Rig
from replicate.approximation.samples import evaluate

USED = 0.02  # of its range: a control farther than this off its default is used
UNUSED_STEP = 0.25  # of the range's longer side: the step of a control that no pose uses


@dataclass(frozen=True)
class Interaction:
    """Mixed and single differences of q pairs of controls in b poses.

    pairs: (q, 2), indices of the controls
    mixed_mm: (b, q), the largest |d_ij| of any vertex
    place: (b, q), that vertex
    single_mm: (b, m), how far each control alone moves any vertex
    mixed_square: (b, n), mm², Σ |d_ij|² over the pairs whose controls both can move the vertex
    single_square: (b, n), mm², Σ of both controls' single squares over the same pairs, halved
    """

    pairs: np.ndarray
    mixed_mm: np.ndarray
    place: np.ndarray
    single_mm: np.ndarray
    mixed_square: np.ndarray
    single_square: np.ndarray

    def ratio(self, poses: slice = slice(None)) -> float:
        """Return the RMS of mixed over the RMS of single differences; zero where nothing moves."""
        single = float(self.single_square[poses].sum())
        return float(np.sqrt(self.mixed_square[poses].sum() / single)) if single else 0.0

    def vertex_ratio(self) -> Float64[np.ndarray, " n"]:
        """Return that ratio for each vertex; NaN for one that no pair moves."""
        mixed, single = self.mixed_square.sum(0), self.single_square.sum(0)
        return np.sqrt(np.divide(mixed, single, out=np.full(len(mixed), np.nan), where=single > 0))

    def share_above(self, limit_mm: float, poses: slice = slice(None)) -> float:
        """Return the share of pairs whose largest mixed difference in any of some poses is above a limit."""
        return float((self.mixed_mm[poses].max(0) > limit_mm).mean()) if len(self.pairs) else 0.0


def no_interaction(vertices: int, controls: int) -> Interaction:
    """Return the empty result, for a rig whose controls can't be tried."""
    pairs, alone = np.zeros((0, 2), np.int64), np.zeros((0, controls))
    nothing = np.zeros((0, vertices))
    return Interaction(pairs, np.zeros((0, 0)), np.zeros((0, 0), np.int64), alone, nothing, nothing)


def acting_steps(rig: Rig, poses: Float[np.ndarray, "b m"]) -> Float64[np.ndarray, " m"]:
    """Return each control's usual step: the median distance from its default, in the poses that use it.

    Its sign is the side of the default that poses use more.
    """
    away = np.asarray(poses, np.float64) - rig.default
    up, down = (np.asarray(part, np.float64) for part in (rig.upper - rig.default, rig.lower - rig.default))
    steps = UNUSED_STEP * np.where(up >= -down, up, down)
    used = np.abs(away) > USED * (up - down)
    for k in np.flatnonzero(used.any(0)):
        moves = away[used[:, k], k]
        steps[k] = np.copysign(np.median(np.abs(moves)), moves.sum())
    return steps


def steps_within(rig: Rig, pose: Float[np.ndarray, " m"], steps: Float[np.ndarray, " m"]) -> Float64[np.ndarray, " m"]:
    """Return the steps from a pose, reversed where only the step itself would leave the control's range."""
    outside, other = (((pose + way) > rig.upper) | ((pose + way) < rig.lower) for way in (steps, -steps))
    return np.where(outside & ~other, -steps, steps)


def draw_pairs(
    groups: Sequence[Int[np.ndarray, " _"]], count: int, generator: np.random.Generator
) -> Int[np.ndarray, "q 2"]:
    """Return up to `count` different pairs (i < j) of controls that are in one group, drawn at random.

    groups: the controls that move each segment.
    """
    size = 1 + max((int(group.max()) for group in groups if len(group)), default=0)
    together = np.zeros((size, size), bool)
    for group in groups:
        together[np.ix_(group, group)] = True
    pairs = np.argwhere(np.triu(together, 1))
    return pairs[np.sort(generator.choice(len(pairs), min(count, len(pairs)), replace=False))]


def interaction(
    rig: Rig,
    poses: Float[np.ndarray, "b m"],
    steps: Float[np.ndarray, " m"],
    pairs: Int[np.ndarray, "q 2"],
    influence: Bool[np.ndarray, "n m"],
    progress: Callable | None = None,
) -> Interaction:
    """Return how pairs of controls interact from some poses: 1 + m + q rig calls a pose, batched.

    poses: raw rig parameters
    steps: each control's, as from `acting_steps`
    pairs: of controls that are tried
    influence: which control can move which vertex
    progress: as of `write_samples`
    """
    b, (n, m), q = len(poses), influence.shape, len(pairs)
    sums = Interaction(
        pairs, np.zeros((b, q)), np.zeros((b, q), np.int64), np.zeros((b, m)), np.zeros((b, n)), np.zeros((b, n))
    )
    with progress(b * (1 + m + q), "interaction", 0) if progress else nullcontext() as bar:
        for row, pose in enumerate(np.asarray(poses, np.float32)):
            _add_pose(sums, row, rig, pose, steps_within(rig, pose, steps).astype(np.float32), influence, bar)
    return sums


def _add_pose(sums: Interaction, row: int, rig: Rig, pose, steps, influence, bar) -> None:
    m = len(steps)
    trials = np.concatenate([pose[None], pose + np.diag(steps)])
    vertices = np.concatenate([part for _, part in evaluate(rig, trials)])
    rest, single = vertices[0], vertices[1:] - vertices[0]  # (m, n, 3)
    lengths = _squares(single)  # (m, n)
    sums.single_mm[row] = np.sqrt(lengths.max(1))
    first, second = sums.pairs.T
    trials = np.repeat(trials[:1], len(first), axis=0)
    places = np.arange(len(first))
    trials[places, first] += steps[first]
    trials[places, second] += steps[second]
    if bar is not None:
        bar.update(1 + m)
    for rows, posed in evaluate(rig, trials):
        i, j = first[rows], second[rows]
        mixed = _squares(posed - rest - single[i] - single[j])  # (k, n)
        both = influence.T[i] & influence.T[j]
        sums.mixed_mm[row, rows], sums.place[row, rows] = np.sqrt(mixed.max(1)), mixed.argmax(1)
        sums.mixed_square[row] += (mixed * both).sum(0, dtype=np.float64)
        sums.single_square[row] += ((lengths[i] + lengths[j]) * both).sum(0, dtype=np.float64) / 2
        if bar is not None:
            bar.update(len(posed))


def _squares(vectors: np.ndarray) -> np.ndarray:
    return np.einsum("knc,knc->kn", vectors, vectors)
