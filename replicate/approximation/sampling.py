"""Which poses a method is trained and tested on: the split, Eq. 5, and the balancing of §3.5.

Poses are rows of raw control values p (m,), in the rig's order and units. Every function gets the `np.random.Generator`
that it draws from.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Float32, Int, Int16

from replicate.base.exceptions import InputError


def split_frames(
    clips: Sequence[np.ndarray], generator: np.random.Generator, held_out: float = 0.1
) -> tuple[Float32[np.ndarray, "a m"], Float32[np.ndarray, "t m"]]:
    """Split an animation by random frames: training poses A, and the unique test poses that A lacks (§5.1).

    clips: arrays (t_i, m), the poses of each clip in time order.
    held_out: share of the frames.

    This is how we read the paper's "randomly split the data 90%/10%". A held-out frame whose very pose is also in A
    leaves the test set; the others count once. A keeps its repetitions, because Eq. 5 draws from the animation as it
    is. Neighbouring frames of a movement may be on both sides; `split_clips` is stricter. Returns both sets in the
    order of the animation. Raises InputError if one would be empty.
    """
    poses = _stack(clips)
    mask = np.zeros(len(poses), dtype=bool)
    mask[generator.permutation(len(poses))[: round(held_out * len(poses))]] = True
    return _separate(poses, mask)


def split_clips(
    clips: Sequence[np.ndarray], generator: np.random.Generator, held_out: float = 0.1
) -> tuple[Float32[np.ndarray, "a m"], Float32[np.ndarray, "t m"]]:
    """Split an animation by whole clips: no test pose has a neighbour in time among the training poses.

    Clips are held out in random order as long as the share of frames stays within `held_out`; the first one always is.
    The rest is as in `split_frames`.
    """
    poses = _stack(clips)
    owner = np.repeat(np.arange(len(clips)), [len(clip) for clip in clips])
    mask = np.zeros(len(poses), dtype=bool)
    for clip in generator.permutation(len(clips)):
        larger = mask | (owner == clip)
        if not mask.any() or larger.sum() <= held_out * len(poses):
            mask = larger
    return _separate(poses, mask)


def _stack(clips: Sequence[np.ndarray]) -> Float32[np.ndarray, "a m"]:
    if not clips:
        raise InputError("the animation has no clips; a rig without animation is sampled uniformly instead")
    return np.concatenate([np.asarray(clip, dtype=np.float32) for clip in clips]) + np.float32(0)  # −0 → +0


def _separate(poses: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    training, candidates = poses[~mask], poses[mask]
    keys = {pose.tobytes() for pose in training}
    fresh = []
    for index, pose in enumerate(candidates):
        key = pose.tobytes()
        if key not in keys:
            keys.add(key)
            fresh.append(index)
    if not len(training) or not fresh:
        raise InputError(
            f"the split of {len(poses)} frames leaves {len(training)} training and {len(fresh)} unique test poses; "
            "each side needs at least one"
        )
    return training, candidates[fresh]


def hold_out(
    poses: Float[np.ndarray, "a m"], count: int, generator: np.random.Generator
) -> tuple[Float32[np.ndarray, "r m"], Float32[np.ndarray, "v m"]]:
    """Take `count` poses out of a training animation for validation; return the rest and these, in their order.

    Only poses that occur once are taken, and at most a tenth of them, so that the rest keeps every pose that the
    animation dwells on. Raises InputError if no pose occurs once.
    """
    _, first, times = np.unique(poses, axis=0, return_index=True, return_counts=True)
    single = np.sort(first[times == 1])
    if not len(single):
        raise InputError(f"each of the {len(poses)} training poses occurs more than once, so none can be held out")
    choice = generator.permutation(single)[: min(count, max(1, len(single) // 10))]
    mask = np.zeros(len(poses), dtype=bool)
    mask[choice] = True
    return poses[~mask], poses[mask]


def augment(
    poses: Float[np.ndarray, "a m"], count: int, generator: np.random.Generator, low: float = 0.25, high: float = 3.0
) -> Float32[np.ndarray, "count m"]:
    """Draw training poses T = {u ⊙ p : u ~ U(low, high)^m, p ~ A}, with replacement (Eq. 5).

    poses: A, training poses only.
    count: how many to draw.
    low, high: the range of the factors u.

    The factors multiply the raw values, so that a control at 0 stays at 0 and nothing changes sign: a sample uses the
    controls that its animator used, and no others. Values reach three times those of the animation, beyond the
    controls' limits; the rig must bear that. All controls of our rigs rest at 0. A control that rests elsewhere, such
    as a gain of 1, is multiplied in *every* sample, whether or not the animation touches it; better redefine it.
    """
    source = generator.integers(len(poses), size=count)
    factors = generator.random((count, poses.shape[1]), dtype=np.float32)
    factors *= np.float32(high - low)
    factors += np.float32(low)
    factors *= np.asarray(poses, dtype=np.float32)[source]
    return factors


def sample_uniform(
    lower: Float[np.ndarray, " m"], upper: Float[np.ndarray, " m"], count: int, generator: np.random.Generator
) -> Float32[np.ndarray, "count m"]:
    """Draw each control independently and uniformly in its range, as the paper does for Ray (§5.1)."""
    spread = generator.random((count, len(lower)), dtype=np.float32)
    return (lower + spread * (np.asarray(upper) - lower)).astype(np.float32)


def balance_bins(landmark_positions: Float[np.ndarray, "k l 3"], bins: int = 16) -> Int16[np.ndarray, " k"]:
    """Sort samples into intervals of equal length along the landmarks' first principal component (§3.5).

    landmark_positions: positions or offsets in mm of the l landmark vertices in each of k samples.
    bins: how many intervals.

    Returns each sample's interval, 0 … bins − 1, some of which may be empty. If no landmark moves, all samples are in
    interval 0.
    """
    points = np.asarray(landmark_positions, dtype=np.float64).reshape(len(landmark_positions), -1)
    centred = points - points.mean(axis=0)
    axis = np.linalg.eigh(centred.T @ centred)[1][:, -1]
    axis *= np.sign(axis[np.argmax(np.abs(axis))])  # an eigenvector's sign is arbitrary
    score = centred @ axis
    span = score.max() - score.min()
    if span <= 1e-9:
        return np.zeros(len(points), dtype=np.int16)
    return np.minimum((score - score.min()) / span * bins, bins - 1).astype(np.int16)


def bin_index(
    bins: Int[np.ndarray, " k"],
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " c"], Int[np.ndarray, " c"]]:
    """Return samples ordered by bin, and the start and size of each non-empty bin in that order.

    bins: each sample's bin.
    """
    order = np.argsort(bins, kind="stable")
    _, starts, sizes = np.unique(np.asarray(bins)[order], return_index=True, return_counts=True)
    return order, starts, sizes


def draw_from_index(
    order: Int[np.ndarray, " k"],
    starts: Int[np.ndarray, " c"],
    sizes: Int[np.ndarray, " c"],
    count: int,
    generator: np.random.Generator,
) -> Int[np.ndarray, " count"]:
    """Draw sample indices: a non-empty bin uniformly, then a sample of that bin uniformly, with replacement (§3.5).

    order, starts, sizes: as `bin_index` returns them.
    count: how many to draw.
    """
    bins = generator.integers(len(starts), size=count)
    return order[starts[bins] + generator.integers(sizes[bins])]
