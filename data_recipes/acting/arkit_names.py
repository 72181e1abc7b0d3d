"""Our controls in ARKit's and ICT-FaceKit's names, so that our acting plays on faces that use those."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache

import numpy as np
from jaxtyping import Float

from data_recipes.acting.motion import pose
from data_recipes.controls import Control

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
LARGEST_WEIGHT = 2.0  # the largest upper limit of a control that counts in weights
# Other programs' names for about the same: VRoid's and VRM's shapes, and MakeHuman's expression units. Several of ours
# may stand for one of theirs.
OTHERS = {
    "Fcl_EYE_Close_L": "eyeBlink_L",
    "Fcl_EYE_Close_R": "eyeBlink_R",
    "Fcl_EYE_Spread": "eyeWide",
    "Fcl_BRW_Surprised": "browOuterUp",
    "Fcl_BRW_Sorrow": "browInnerUp",
    "Fcl_BRW_Angry": "browDown",
    "Fcl_MTH_A": "jawOpen",
    "Fcl_MTH_U": "mouthPucker",
    "Fcl_MTH_O": "mouthFunnel",
    "Fcl_MTH_I": "mouthStretch",
    "Fcl_MTH_Joy": "mouthSmile",
    "Fcl_MTH_Sorrow": "mouthFrown",
    "blink_l": "eyeBlink_L",
    "blink_r": "eyeBlink_R",
    "mouth-open": "jawOpen",
    "mouth-corner-puller": "mouthSmile",
    "mouth-depression": "mouthFrown",
    "mouth-elevation": "mouthUpperUp",
    "mouth-depression-retraction": "mouthLowerDown",
    "mouth-compression": "mouthPress",
    "mouth-pursing": "mouthPucker",
    "mouth-protusion": "mouthFunnel",
    "mouth-retraction": "mouthStretch",
}
_BOTH = {  # MakeHuman's of one side
    "eye-*-closure": "eyeBlink",
    "eye-*-opened-up": "eyeWide",
    "eye-*-slit": "eyeSquint",
    "eyebrows-*-down": "browDown",
    "eyebrows-*-inner-up": "browInnerUp",
    "eyebrows-*-extern-up": "browOuterUp",
    "nose-*-elevation": "noseSneer",
}
OTHERS |= {a.replace("*", side): f"{b}_{letter}" for a, b in _BOTH.items() for side, letter in SIDES.items()}


def canonical(name: str) -> str:
    """Return ICT-FaceKit's name for a control as ARKit, VRM or Ready Player Me call it; any other name as it is.

    "eyeBlinkLeft", "EyeBlink_L" and "head.eye_blink_left" are eyeBlink_L. What ARKit has once for both sides keeps a
    name without a side.
    """
    return _known().get(_plain(name), name)


@cache
def _known() -> dict[str, str]:
    known = {}
    for theirs in {theirs for _, _, theirs, _ in name_pairs()} | {"tongueOut"}:
        stem, letter = (theirs[:-2], theirs[-1]) if theirs[-2:] in ("_L", "_R") else (theirs, "")
        known[_plain(theirs)] = theirs
        if letter:
            known[_plain(stem + {"L": "Left", "R": "Right"}[letter])] = theirs
            known.setdefault(_plain(stem), stem)
    return known | {_plain(name): theirs for name, theirs in OTHERS.items()}


def _plain(name: str) -> str:
    plain = re.sub(r"[^a-z0-9]", "", re.split(r"[.|:/]", name)[-1].lower())
    return re.sub("^.*(?=fcl)", "", plain)  # VRoid's names begin with those of their files


def arkit_parts(name: str) -> tuple[str, ...]:
    """Return what a control moves in the names of `canonical`: two where it moves both sides, () if unknown."""
    known, every = canonical(name), set(_known().values())
    sides = tuple(f"{known}_{letter}" for letter in SIDES.values() if f"{known}_{letter}" in every)
    return sides or ((known,) if known in every else ())


def play_weights(
    names: Sequence[str], weights: Float[np.ndarray, "t k"], controls: Sequence[Control]
) -> tuple[Float[np.ndarray, "t m"], list[str]]:
    """Return what a rig's parameters are when ARKit's shapes have these weights, and which of them it lacks.

    names: of the k shapes, as any program writes them. A rig with our names gets the shares of `NAMES` backwards; what
    a rig has once for both sides gets their mean. A control whose upper limit is beyond `LARGEST_WEIGHT`, such as 100,
    reaches it where a weight is 1.
    """
    wanted, columns = _columns(names, [control.name for control in controls])
    lower, default, upper = (
        np.array([getattr(control, name) for control in controls]) for name in ("lower", "default", "upper")
    )
    full = np.where(upper > LARGEST_WEIGHT, upper, 1.0) - default
    amounts = np.zeros((len(weights), len(controls)))
    for part, place in wanted.items():
        for name, share in _counterparts(part, wanted, columns):
            amounts[:, columns[name]] += share * weights[:, place]
    return np.clip(default + amounts * full, lower, upper), without_counterpart(names, columns)


def without_counterpart(names: Sequence[str], controls: Iterable[str]) -> list[str]:
    """Return which of ARKit's shapes nothing stands for in a rig with these controls."""
    wanted, columns = _columns(names, list(controls))
    reached = {place for part, place in wanted.items() if _counterparts(part, wanted, columns)}
    return [name for place, name in enumerate(names) if place not in reached]


def _columns(names: Sequence[str], controls: Sequence[str]) -> tuple[dict[str, int], dict[str, int]]:
    """Return the places of shapes by `arkit_parts`, and those of controls by `canonical` and by their own names."""
    wanted = {part: place for place, name in enumerate(names) for part in arkit_parts(name)}
    columns = {canonical(name): place for place, name in reversed(list(enumerate(controls)))}
    return wanted, columns | {name: place for place, name in enumerate(controls)}


def _counterparts(part: str, wanted: Mapping[str, int], columns: Mapping[str, int]) -> list[tuple[str, float]]:
    """Return the controls of a rig that stand for one of ARKit's shapes, each with its share of the weight."""
    if part in columns:
        return [(part, 1.0)]
    if part[-2:] in ("_L", "_R") and part[:-2] in columns:
        return [(part[:-2], 1 / sum(f"{part[:-2]}_{letter}" in wanted for letter in SIDES.values()))]
    pairs = [(ours, sign, share) for ours, sign, theirs, share in name_pairs() if theirs == part and ours in columns]
    most = max((share for *_, share in pairs), default=0.0)
    main = [(ours, sign, share) for ours, sign, share in pairs if share == most]
    return [(ours, sign / (len(main) * share)) for ours, sign, share in main]


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

    ours, theirs: the names of the m and of the k controls, in order; theirs as any program writes them.
    """
    our_columns = {name: column for column, name in enumerate(ours)}
    their_columns = {canonical(name): column for column, name in reversed(list(enumerate(theirs)))}
    values = np.zeros((len(poses), len(theirs)))
    for our_name, sign, their_name, share in name_pairs():
        if their_name not in their_columns and their_name[-2:] in ("_L", "_R"):  # one control for both sides
            their_name, share = their_name[:-2], share / 2
        if our_name in our_columns and their_name in their_columns:
            values[:, their_columns[their_name]] += share * np.maximum(sign * poses[:, our_columns[our_name]], 0)
    return np.clip(values, 0, 1)


def our_pose(columns: Mapping[str, int], amounts: Mapping[str, float]) -> Float[np.ndarray, " k"]:
    """Return a pose of a rig with their controls from amounts of ours; "*" stands for both sides."""
    ours = {name: column for column, name in enumerate(dict.fromkeys(name for name, *_ in name_pairs()))}
    return in_their_words(list(ours), list(columns), pose(ours, amounts)[None])[0]
