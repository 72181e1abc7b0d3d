"""Poses that put every part of a rig to work."""

import numpy as np

from data_recipes.rig import Rig


def augmented(rig: Rig, count: int, seed: int = 0) -> np.ndarray:
    """Eq. 5 with clips of the rig's own: animation values times U(0.25, 3)."""
    generator = np.random.default_rng(seed)
    poses = np.concatenate([clip.values for clip in rig.clips])
    return poses[generator.integers(0, len(poses), count)] * generator.uniform(0.25, 3, (count, poses.shape[1]))


MOVES = {"brow_inner_up": 1, "smile": 0.8, "jaw_open": 0.7, "squint": 1, "blink": 0.6, "squash": 0.5, "nose_wrinkle": 1}


def strained(rig: Rig) -> np.ndarray:
    """A pose in which every node has something to do, some controls beyond their limits, as a batch of one."""
    p = np.array([next((v for n, v in MOVES.items() if c.name.startswith(n)), 0.0) for c in rig.controls])
    p += [2.5 * c.name.endswith("_x") + 0.8 * c.name.startswith(("lips_together", "sticky")) for c in rig.controls]
    return p[None].astype(np.float32)
