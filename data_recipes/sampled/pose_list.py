"""The poses of all shards as one list: their parameters, and which of them are frames of clips, in their order.

Frames stand in the order of their clips' names and their own numbers, whatever shard they are in; poses drawn at random
in the order of the shards.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Int

from data_recipes.sampled.shards import Shard
from replicate.engine.exceptions import InputError
from replicate.engine.schema import shown

FARTHEST = 1_000.0  # ranges that a parameter may be from its default; Eq. 5 reaches three
MOST_POSES = 2_000_000
LEAST_POSES = 20  # frames, or where there are none, poses
NO_SOURCE = -1


@dataclass(frozen=True)
class PoseList:
    """The t poses of some shards.

    shard, row: (t,) where each is. params: (t, m). clips: (name, number of frames) of each clip, in order. frames: the
    poses that are frames of these, one clip after the other. drawn: all other poses; source: of each of those the
    place in `frames` of what it was drawn from, or NO_SOURCE. numbers: of each frame, in its clip.
    """

    shard: Int[np.ndarray, " t"]
    row: Int[np.ndarray, " t"]
    params: Float32[np.ndarray, "t m"]
    clips: tuple[tuple[str, int], ...]
    frames: Int[np.ndarray, " a"]
    numbers: Int[np.ndarray, " a"]
    drawn: Int[np.ndarray, " d"]
    source: Int[np.ndarray, " d"]


def list_poses(
    shards: Sequence[Shard], where: str, lower: np.ndarray, default: np.ndarray, upper: np.ndarray
) -> PoseList:
    """Return the poses of some shards.

    Raises InputError, beginning with `where`, for parameters that are not finite or farther from their defaults than
    anyone would set them, for frames that are there twice, and for too few or too many poses.
    """
    total = sum(shard.poses for shard in shards)
    if total > MOST_POSES:
        raise InputError(f"{where}: found {total:,} poses: allowed are {MOST_POSES:,} at most")
    params, clip, frame, drawn = [], [], [], []
    for shard in shards:
        params.append(_params(shard, where, lower, default, upper))
        has_clip = "clip" in shard.headers
        clip += shard.read("clip").tolist() if has_clip else [""] * shard.poses
        frame.append(_whole(shard, where) if has_clip else np.zeros(shard.poses, np.int64))
        is_drawn = shard.read("drawn") if "drawn" in shard.headers else np.zeros(shard.poses, bool)
        drawn.append(is_drawn)
    names = np.array(clip, dtype=str)
    frame, drawn = np.concatenate(frame), np.concatenate(drawn)
    of_clip = (names != "") & ~drawn
    frames = np.flatnonzero(of_clip)
    order = sorted(dict.fromkeys(names[frames].tolist()), key=_natural)
    rank = {name: k for k, name in enumerate(order)}
    frames = frames[np.lexsort((frame[frames], [rank[name] for name in names[frames].tolist()]))]
    keys = [(names[k], int(frame[k])) for k in frames]
    place = {key: k for k, key in enumerate(keys)}
    if len(place) < len(keys):
        twice = next(key for k, key in enumerate(keys) if place[key] != k)
        raise InputError(f"{where}: frame {twice[1]} of clip {shown(str(twice[0]))} is there twice: allowed is once")
    lengths = [(name, int((names[frames] == name).sum())) for name in order]
    others = np.flatnonzero(~of_clip)
    source = [place.get((names[k], int(frame[k])), NO_SOURCE) if names[k] != "" else NO_SOURCE for k in others]
    count, what = (len(frames), "frames of clips") if len(frames) else (len(others), "poses")
    if count < LEAST_POSES:
        raise InputError(f"{where}: found {count} {what}: allowed are {LEAST_POSES} at least")
    return PoseList(
        np.repeat(np.arange(len(shards)), [shard.poses for shard in shards]),
        np.concatenate([np.arange(shard.poses) for shard in shards]),
        np.concatenate(params),
        tuple(lengths),
        frames,
        frame[frames],
        others,
        np.array(source, np.int64),
    )


def _params(shard: Shard, where: str, lower: np.ndarray, default: np.ndarray, upper: np.ndarray) -> np.ndarray:
    params = shard.read("params").astype(np.float64)
    bad = np.argwhere(~(np.abs(params - default) <= FARTHEST * (upper - lower).astype(np.float64)))  # True for NaN too
    if len(bad):
        pose, control = bad[0]
        value = shown(float(params[pose, control]))
        allowed = f"finite numbers within {FARTHEST:g} ranges of the default"
        raise InputError(f"{where}/{shard.name}: params[{pose}, {control}] is {value}: allowed are {allowed}")
    return params.astype(np.float32) + np.float32(0)  # −0 → +0


def _whole(shard: Shard, where: str) -> np.ndarray:
    frame = shard.read("frame")
    bad = np.flatnonzero((frame < 0) | (frame > 10**9))
    if len(bad):
        raise InputError(
            f"{where}/{shard.name}: frame[{bad[0]}] is {frame[bad[0]]}: allowed are 0 to a thousand million"
        )
    return frame.astype(np.int64)


def _natural(name: str) -> list:
    """Return what sorts names with numbers in them as people do: 2 before 10."""
    return [
        (int(part), "") if part.isdecimal() and part.isascii() else (-1, part) for part in re.split(r"([0-9]+)", name)
    ]
