"""Expressions as amounts of the named controls.

"*" stands for both sides. Amounts are those of a full but not extreme performance; `procedural_acting` scales them,
makes them uneven and leaves out the controls that a smaller rig lacks. An expression has everything that the face does
together: a smile lifts the cheeks and narrows the eyes, a cry opens the jaw and squares the lower lip.
"""

from collections.abc import Container

import numpy as np
from jaxtyping import Float32

from data_recipes.acting.antics import ANTICS, CREATURE
from data_recipes.acting.arkit_names import LARGEST_WEIGHT, our_pose
from data_recipes.acting.feelings import FEELINGS
from data_recipes.acting.motion import pose
from data_recipes.rig import Rig, has_function

EXPRESSIONS = FEELINGS | ANTICS
MARK = "snarl_left"  # a control that only creatures have


def expression(name: str, controls: Container[str]) -> dict[str, float]:
    """Return an expression's amounts for a rig with controls of these names."""
    return EXPRESSIONS[name] | (CREATURE.get(name, {}) if MARK in controls else {})


# A rig's expressions as poses, whether its controls have our names or ARKit's.


def expression_poses(rig: Rig) -> dict[str, Float32[np.ndarray, " m"]]:
    """Return a face's expressions by name, the neutral pose first, as parameters (m,) within the controls' ranges.

    A control in ARKit's names whose upper limit is beyond `LARGEST_WEIGHT`, such as 100, reaches it at a weight of 1.
    A rig with neither our control names nor ARKit's has only the neutral pose; one that is known by its samples has
    some frames of its clips.
    """
    if not has_function(rig):
        return shown_frames(rig)
    columns = {control.name: index for index, control in enumerate(rig.controls)}
    poses, full = {"neutral": rig.default}, np.where(rig.upper > LARGEST_WEIGHT, rig.upper, 1.0)
    for name in EXPRESSIONS:
        amounts = expression(name, columns)
        values = pose(columns, amounts) + full * our_pose(columns, amounts)
        values = np.clip(values, rig.lower, rig.upper).astype(np.float32)
        if values.any():
            poses[name] = values
    return poses


# Poses of a rig without named expressions: the neutral one, and known poses that are far apart.

COUNT = 11
LOOKED_AT = 2_000  # poses, evenly spread over all


def shown_frames(rig: Rig) -> dict[str, Float32[np.ndarray, " m"]]:
    """Return known poses (m,) by name: "neutral", then <clip>_<frame, from 0>, or pose_<k> without clips.

    Each is the one farthest from the defaults and from all before it, measured in ranges of controls.
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
