"""The last tenth of an animator's work: tweak handles, lip points, lid arcs and wrinkles nudged on key poses.

Nudges come in gestures of one family of controls (the brow handles, the upper lip, …) that move together, because
nobody pulls one point of a lip out of line. Each shot deals itself a few families from a shuffled deck, so that
every family is used in many shots and no shot uses all.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float64

# Family → beginnings of the names of its controls.
FAMILIES: dict[str, tuple[str, ...]] = {
    "brow handles": ("handle_brow",),
    "forehead handles": ("handle_forehead", "handle_glabella"),
    "cheek handles": ("handle_cheek",),
    "jaw handles": ("handle_jaw", "handle_chin"),
    "nose handles": ("handle_nose",),
    "fold handles": ("handle_nasolabial",),
    "temple and ear handles": ("handle_temple", "handle_ear"),
    "throat handle": ("handle_throat", "throat_swallow"),
    "upper lip": ("lip_upper",),
    "lower lip": ("lip_lower",),
    "lip corners": ("lip_corner", "sticky"),
    "upper lids": ("lid_upper",),
    "lower lids": ("lid_lower", "eyebag", "lid_corner"),
    "lid creases": ("crease",),
    "upper wrinkles": ("wrinkle_forehead", "wrinkle_glabella", "wrinkle_crow"),
    "lower wrinkles": ("wrinkle_nasolabial", "wrinkle_nose", "wrinkle_chin", "wrinkle_under_eye"),
    "head shape": ("shape", "squash_upper", "squash_lower"),
    "lid follow": ("follow",),
    "tongue": ("tongue",),
    "lip rolls": ("lip_roll", "mouth_up_down", "mouth_sideways"),
    "head attitude": ("bend", "twist"),
    "frills": ("frill",),
    "ear turns": ("ear_spread", "ear_fold"),
    "snout": ("snarl", "jowl", "brow_ridge", "throat_pouch"),
    "jaw and nose offsets": ("jaw_forward", "jaw_sideways", "jaw_twist", "nose_up_down", "nose_sideways", "scalp"),
    "folds and tendons": ("nasolabial_deepen", "neck_tendon"),
}
# A full bend moves the crown by half a decimetre, a full lip point a lip by 4 mm: families that a face is sparing with.
QUIET = {"head attitude": 0.3, "head shape": 0.5}
ACTIVE_SHARE = 0.75  # share of a family's controls that a gesture moves


def family_columns(columns: Mapping[str, int]) -> dict[str, dict[str, int]]:
    """Return each family's controls, name → column, leaving out families that the rig lacks altogether."""
    families = {
        family: {name: column for name, column in columns.items() if name.startswith(starts)}
        for family, starts in FAMILIES.items()
    }
    return {family: members for family, members in families.items() if members}


def deal(families: Sequence[str], shots: int, hand: int, generator: np.random.Generator) -> list[list[str]]:
    """Return each shot's families: `hand` of them, dealt from shuffled decks so that all are used equally often."""
    deck: list[str] = []
    hands = []
    for _ in range(shots):
        while len(deck) < hand:
            fresh = [str(name) for name in generator.permutation(list(families))]
            deck += [name for name in fresh if name not in deck] + [name for name in fresh if name in deck]
        hands.append(deck[:hand])
        deck = deck[hand:]
    return hands


def gesture(
    members: Mapping[str, int], m: int, amount: float, generator: np.random.Generator
) -> Float64[np.ndarray, " m"]:
    """Return one nudge of a family: a common direction, some play in each control, even or uneven sides.

    members: name → column. amount: the typical size of the common direction. Sideways axes are mirrored between
    the sides, so that an even gesture widens or narrows the face instead of shifting it.
    """
    common = {axis: generator.normal() for axis in ("x", "y", "z", "")}
    sides = [(1, 1), (1, 1), (1, 0.3), (0.3, 1), (1, 0), (0, 1), (1, -0.6)][generator.integers(7)]
    values = np.zeros(m)
    for name, column in members.items():
        axis = name[-1] if name[-2:] in ("_x", "_y", "_z") else ""
        left, right = _is_side(name, "left"), _is_side(name, "right")
        share = sides[0] if left else sides[1] if right else 1.0
        mirror = -1.0 if axis == "x" and right else 1.0
        play = generator.normal()
        if generator.random() < ACTIVE_SHARE:
            values[column] = amount * share * (mirror * common[axis] + 0.6 * play)
    return values


def _is_side(name: str, side: str) -> bool:
    """Tell the side in a name; lip points are numbered 01 … 05 from the character's right to its left."""
    numbers = {"left": ("_04_", "_05_"), "right": ("_01_", "_02_")}[side]
    return side in name.split("_") or (name.startswith("lip_") and any(number in name for number in numbers))
