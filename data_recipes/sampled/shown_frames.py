"""Poses to show of a rig that has no expressions by name: the neutral one, and known poses that are far apart."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32

from data_recipes.rig import Rig

COUNT = 11
LOOKED_AT = 2_000  # poses, evenly over all


def shown_frames(rig: Rig) -> dict[str, Float32[np.ndarray, " m"]]:
    """Return known poses (m,) by name: "neutral", then <clip>_<frame of it, from 0>, or pose_<number> without clips.

    The first is the farthest from the defaults, each further one the farthest from all before it, in ranges of
    controls.
    """
    if rig.clips:
        names = [f"{clip.name}_{k}" for clip in rig.clips for k in range(len(clip.values))]
        poses = np.concatenate([clip.values for clip in rig.clips])
    else:
        poses = np.asarray(rig.known_poses.frame_params)
        names = [f"pose_{k}" for k in range(len(poses))]
    some = np.unique(np.linspace(0, len(poses) - 1, LOOKED_AT).astype(int))
    places = ((poses[some] - rig.default) / (rig.upper - rig.lower)).astype(np.float64)
    distance, shown = (places**2).sum(axis=1), {"neutral": rig.default}
    for _ in range(COUNT):
        k = int(np.argmax(distance))
        if distance[k] <= 0:
            break
        shown[names[some[k]]] = np.array(poses[some[k]], np.float32)
        distance = np.minimum(distance, ((places - places[k]) ** 2).sum(axis=1))
    return shown
