"""Poses for figures: amounts of named controls, as a riggers' sheet lists them."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float32

from data_recipes.rig import Rig
from replicate.engine.exceptions import InputError

SIDES = ("left", "right")


def pose_params(rig: Rig, amounts: Mapping[str, float]) -> Float32[np.ndarray, " m"]:
    """Return parameters (m,): the defaults and these amounts; "*" in a name stands for both sides.

    Controls that a smaller rig lacks are left out. Raises InputError if it lacks all of them.
    """
    columns = {control.name: k for k, control in enumerate(rig.controls)}
    params, matches = rig.default.copy(), 0
    for pattern, amount in amounts.items():
        for name in dict.fromkeys(pattern.replace("*", side) for side in SIDES):
            if name in columns:
                params[columns[name]] = amount
                matches += 1
    if amounts and not matches:
        names = ", ".join(amounts)
        raise InputError(f"rig '{rig.name}': it has none of the controls {names}; `rig.controls` lists those it has.")
    return params
