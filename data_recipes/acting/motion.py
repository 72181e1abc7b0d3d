"""How a face gets from one pose to the next: eased keys with anticipation and overshoot, blinks, drift, holds.

Poses are rows (m,) of control values; time is counted in frames at 24 a second.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from jaxtyping import Float, Float64, Int

FRAMES_PER_SECOND = 24
SIDES = ("left", "right")


def pose(columns: Mapping[str, int], amounts: Mapping[str, float]) -> Float64[np.ndarray, " m"]:
    """Return a pose from amounts by name; "*" stands for both sides, and controls that the rig lacks are left out.

    columns: control name → column of p.
    """
    values = np.zeros(len(columns))
    for name, amount in amounts.items():
        for side in SIDES if "*" in name else ("",):
            column = columns.get(name.replace("*", side))
            if column is not None:
                values[column] = amount
    return values


def move_keys(
    start: float,
    length: float,
    before: Float[np.ndarray, " m"],
    after: Float[np.ndarray, " m"],
    anticipation: float,
    overshoot: float,
) -> list[tuple[float, np.ndarray]]:
    """Return (time, pose) keys of one move: a little the other way, past the goal, and back to it.

    start, length: frames; the last key is at start + length.
    before, after: poses.
    anticipation: how far the move goes the other way first, as a share of the way from `before` to `after`.
    overshoot: how far it goes past the goal, as such a share.
    """
    way = after - before
    keys = [(start, before)]
    if anticipation > 0:
        keys.append((start + 0.25 * length, before - anticipation * way))
    if overshoot > 0:
        keys.append((start + 0.75 * length, after + overshoot * way))
    return [*keys, (start + length, after)]


def through(
    keys: Sequence[tuple[float, np.ndarray]], frames: int, lag: Int[np.ndarray, " m"]
) -> Float64[np.ndarray, "frames m"]:
    """Interpolate keys by monotone cubics, which ease in and out of every extreme and never ring.

    keys: (time, pose) in time order; of equal times the later pose counts. Before the first and after the last key the
    pose doesn't change.
    lag: frames by which each control drags behind, so that parts of the face overlap in time.
    """
    pose_at = {float(time): value for time, value in keys}
    times = np.array(sorted(pose_at))
    poses = np.stack([pose_at[time] for time in times])
    if len(times) == 1:
        return np.repeat(poses, frames, axis=0)
    values = np.empty((frames, poses.shape[1]))
    for late in np.unique(lag):
        mask = lag == late
        when = np.clip(np.arange(frames) - late, times[0], times[-1])
        values[:, mask] = _curve(times, poses[:, mask])(when)
    return values


def _curve(times: Float[np.ndarray, " k"], values: Float[np.ndarray, "k ..."]) -> Callable:
    """Return the monotone cubic through keys as a function of time."""
    from scipy.interpolate import PchipInterpolator  # slow to import, and reading a recipe imports this module

    return PchipInterpolator(times, values, axis=0)


def blink_profile(frames: int, starts: Sequence[float], slowness: float = 1.0) -> Float64[np.ndarray, " frames"]:
    """Return how far lids are closed by blinks (0 … 1): two frames down, one closed, four up, times `slowness`."""
    shape_time = np.array([0.0, 2.0, 3.2, 5.0, 7.5]) * slowness
    closure = _curve(shape_time, np.array([0.0, 1.0, 1.0, 0.35, 0.0]))
    profile = np.zeros(frames)
    for start in starts:
        time = np.arange(frames) - start
        during = (time > 0) & (time < shape_time[-1])
        profile[during] = np.maximum(profile[during], closure(time[during]))
    return profile


def drift(
    frames: int, count: int, period: float, generator: np.random.Generator
) -> Float64[np.ndarray, "frames count"]:
    """Return slow noise of unit size, a column for each control: random keys `period` frames apart, eased."""
    keys = generator.normal(size=(int(frames / period) + 3, count))
    start = generator.uniform(0, period)
    return _curve(np.arange(len(keys)) * period - start, keys)(np.arange(frames))


def freeze(values: Float[np.ndarray, "frames m"], holds: Mapping[int, int]) -> Float[np.ndarray, "longer m"]:
    """Repeat some frames: `holds` maps a frame to the number of frames for which everything stands still."""
    repeats = np.ones(len(values), dtype=int)
    for frame, count in holds.items():
        repeats[min(frame, len(values) - 1)] += count
    return np.repeat(values, repeats, axis=0)
