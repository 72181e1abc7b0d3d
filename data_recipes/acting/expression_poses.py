"""A rig's expressions as poses, whether its controls have our names or ARKit's."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32

from data_recipes.acting.arkit_names import our_pose
from data_recipes.acting.expressions import EXPRESSIONS, expression
from data_recipes.acting.motion import pose
from data_recipes.rig import Rig, has_function
from data_recipes.sampled.shown_frames import shown_frames


def expression_poses(rig: Rig) -> dict[str, Float32[np.ndarray, " m"]]:
    """Return a face's expressions by name, each as parameters (m,) within the controls' ranges; the neutral pose first.

    A rig whose controls have other names than ours, or than ARKit's, has the neutral pose alone; one that is known by
    its samples has some frames of its clips.
    """
    if not has_function(rig):
        return shown_frames(rig)
    columns = {control.name: index for index, control in enumerate(rig.controls)}
    poses = {"neutral": rig.default}
    for name in EXPRESSIONS:
        amounts = expression(name, columns)
        values = np.clip(pose(columns, amounts) + our_pose(columns, amounts), rig.lower, rig.upper).astype(np.float32)
        if values.any():
            poses[name] = values
    return poses
