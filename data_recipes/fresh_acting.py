"""A performance that is in no character's animation: the same acting from another seed, to be captured (§5.3.2)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32

from data_recipes.acting.procedural_acting import Acting, act
from data_recipes.ict.facekit_acting import perform
from data_recipes.rig import Rig
from replicate.engine.exceptions import InputError

AFRESH = Acting(seed=54, clips=3, clip_s=4.0)  # an emotion, a take and a dialogue


def perform_afresh(rig: Rig) -> Float32[np.ndarray, "t m"]:
    """Return the frames of the performance, (t, m) within the controls' limits, 24 a second; each shot begins at rest.

    Raises InputError for a rig with other controls than ours or ARKit's.
    """
    for shots in (act, perform):
        values = np.concatenate([values for _, values in shots(rig.controls, AFRESH)])
        if (values != rig.default).any():
            return np.clip(values, rig.lower, rig.upper).astype(np.float32)
    raise InputError(f"rig '{rig.name}': it has none of the controls that our acting moves, so it can't be the actor.")
