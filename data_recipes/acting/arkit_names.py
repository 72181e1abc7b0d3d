"""Our controls in ARKit's and ICT-FaceKit's names, so that our acting plays on faces that use those."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from data_recipes.acting.motion import pose

# Our control and the sign of its amount → their controls, each with its share. "*" stands for both sides.
NAMES: tuple[tuple[str, int, dict[str, float]], ...] = (
    ("brow_inner_up_*", 1, {"browInnerUp_*": 1.0}),
    ("brow_outer_up_*", 1, {"browOuterUp_*": 1.0}),
    ("brow_down_*", 1, {"browDown_*": 0.9}),
    ("brow_squeeze_*", 1, {"browDown_*": 0.3}),
    ("scalp_raise", 1, {"browOuterUp_left": 0.15, "browOuterUp_right": 0.15}),
    ("smile_*", 1, {"mouthSmile_*": 1.0}),
    ("blink_*", 1, {"eyeBlink_*": 1.0}),
    ("frown_*", 1, {"mouthFrown_*": 1.0}),
    ("pucker_*", 1, {"mouthPucker": 0.5}),
    ("funnel_*", 1, {"mouthFunnel": 0.5}),
    ("upper_lip_raise_*", 1, {"mouthUpperUp_*": 1.0}),
    ("lower_lip_depress_*", 1, {"mouthLowerDown_*": 1.0}),
    ("nose_wrinkle_*", 1, {"noseSneer_*": 0.9}),
    ("squint_*", 1, {"eyeSquint_*": 1.0}),
    ("eye_wide_*", 1, {"eyeWide_*": 1.0}),
    ("cheek_raise_*", 1, {"cheekSquint_*": 0.9}),
    ("cheek_puff_*", 1, {"cheekPuff_*": 1.0}),
    ("mouth_stretch_*", 1, {"mouthStretch_*": 0.9}),
    ("dimple_*", 1, {"mouthDimple_*": 0.9}),
    ("lip_press_*", 1, {"mouthPress_*": 1.0}),
    ("chin_raise", 1, {"mouthShrugLower": 1.0, "mouthShrugUpper": 0.4}),
    ("lip_roll_upper", 1, {"mouthRollUpper": 0.8}),
    ("lip_roll_lower", 1, {"mouthRollLower": 0.8}),
    ("lip_roll_lower", -1, {"mouthFunnel": 0.25}),
    ("mouth_sideways", 1, {"mouthLeft": 0.7}),
    ("mouth_sideways", -1, {"mouthRight": 0.7}),
    ("mouth_up_down", 1, {"mouthShrugUpper": 0.6}),
    ("jaw_open", 1, {"jawOpen": 1.0}),
    ("jaw_drop", 1, {"jawOpen": 0.15}),
    ("jaw_forward", 1, {"jawForward": 0.8}),
    ("jaw_sideways", 1, {"jawLeft": 0.8}),
    ("jaw_sideways", -1, {"jawRight": 0.8}),
    ("lips_together", 1, {"mouthClose": 1.0}),
    ("look_y_*", 1, {"eyeLookUp_*": 1.0}),
    ("look_y_*", -1, {"eyeLookDown_*": 1.0}),
    ("look_x_left", 1, {"eyeLookOut_left": 1.0}),
    ("look_x_left", -1, {"eyeLookIn_left": 1.0}),
    ("look_x_right", 1, {"eyeLookIn_right": 1.0}),
    ("look_x_right", -1, {"eyeLookOut_right": 1.0}),
)
SIDES = {"left": "L", "right": "R"}


def name_pairs() -> list[tuple[str, int, str, float]]:
    """Return (our name, sign, their name, share) for both sides."""
    pairs = []
    for ours, sign, theirs in NAMES:
        for side in SIDES if "*" in ours else ("",):
            for name, share in theirs.items():
                name = name.replace("*", side)
                for word, letter in SIDES.items():
                    name = name.removesuffix(word) + letter if name.endswith("_" + word) else name
                pairs.append((ours.replace("*", side), sign, name, share))
    return pairs


def in_their_words(
    ours: Sequence[str], theirs: Sequence[str], poses: Float[np.ndarray, "t m"]
) -> Float[np.ndarray, "t k"]:
    """Return poses of our controls as poses of theirs, from 0 to 1; controls without a counterpart are left out.

    ours, theirs: the names of the m and of the k controls, in order.
    """
    our_columns = {name: column for column, name in enumerate(ours)}
    their_columns = {name: column for column, name in enumerate(theirs)}
    values = np.zeros((len(poses), len(theirs)))
    for our_name, sign, their_name, share in name_pairs():
        if our_name in our_columns and their_name in their_columns:
            values[:, their_columns[their_name]] += share * np.maximum(sign * poses[:, our_columns[our_name]], 0)
    return np.clip(values, 0, 1)


def our_pose(columns: Mapping[str, int], amounts: Mapping[str, float]) -> Float[np.ndarray, " k"]:
    """Return a pose of a rig with their controls from amounts of ours; "*" stands for both sides."""
    ours = {name: column for column, name in enumerate(dict.fromkeys(name for name, *_ in name_pairs()))}
    return in_their_words(list(ours), list(columns), pose(ours, amounts)[None])[0]
