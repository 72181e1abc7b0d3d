"""The named controls of a rig: what an animator sees, group by group.

Every control has default 0, so that Eq. 5 (values times U(0.25, 3)) leaves a control at rest at rest. One-sided
controls run from 0 to 1, two-sided ones from −1 to 1; the deformers decide what 1 means in millimetres or degrees. A
recipe says how many controls of each group a character has; it gets the first ones of the list, where the most
expressive ones stand.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from replicate.base.exceptions import InputError


@dataclass(frozen=True)
class Control:
    """One rig parameter: its name, its range and default (unitless), and the face region it belongs to.

    Raises InputError when the range is empty or not finite, or the default lies outside it.
    """

    name: str
    lower: float
    default: float
    upper: float
    region: str

    def __post_init__(self) -> None:
        limits = (self.lower, self.default, self.upper)
        if not np.all(np.isfinite(limits)):
            raise InputError(f"control '{self.name}': lower, default and upper must be finite, got {limits}")
        reach = f"[{self.lower:g}, {self.upper:g}]"
        if not self.lower < self.upper:
            raise InputError(f"control '{self.name}': lower must be below upper, but the range {reach} is empty")
        if not self.lower <= self.default <= self.upper:
            raise InputError(f"control '{self.name}': the default {self.default:g} lies outside the range {reach}")


SIDES = ("left", "right")  # of the character; its left is +x
AXES = ("x", "y", "z")

# Face actions that come in pairs (name, region); "*" becomes the side.
FACE_PAIRS = (
    ("brow_inner_up_*", "brows"),
    ("brow_outer_up_*", "brows"),
    ("brow_down_*", "brows"),
    ("smile_*", "mouth"),
    ("blink_*", "eye_*"),
    ("frown_*", "mouth"),
    ("pucker_*", "mouth"),
    ("upper_lip_raise_*", "mouth"),
    ("lower_lip_depress_*", "mouth"),
    ("nose_wrinkle_*", "nose"),
    ("squint_*", "eye_*"),
    ("brow_squeeze_*", "brows"),
    ("eye_wide_*", "eye_*"),
    ("cheek_raise_*", "cheeks"),
    ("cheek_puff_*", "cheeks"),
    ("mouth_stretch_*", "mouth"),
    ("dimple_*", "mouth"),
    ("funnel_*", "mouth"),
    ("lip_press_*", "mouth"),
    ("nostril_flare_*", "nose"),
    ("neck_tighten_*", "neck"),
    ("ear_raise_*", "ears"),
)
# Face actions without sides (name, lower, region).
FACE_SINGLES = (
    ("chin_raise", 0.0, "jaw"),
    ("lip_roll_upper", -1.0, "mouth"),
    ("lip_roll_lower", -1.0, "mouth"),
    ("mouth_sideways", -1.0, "mouth"),
    ("mouth_up_down", -1.0, "mouth"),
    ("nose_up_down", -1.0, "nose"),
    ("throat_swallow", 0.0, "neck"),
    ("scalp_raise", -1.0, "brows"),
)
# Further face actions, ((name, region), lower), that only the larger rigs have.
FACE_MORE = (
    (("nasolabial_deepen_*", "cheeks"), 0.0),
    (("neck_tendon_*", "neck"), 0.0),
    (("nose_sideways", "nose"), -1.0),
)
JAW = (
    ("jaw_open", 0.0, "jaw"),
    ("jaw_sideways", -1.0, "jaw"),
    ("jaw_forward", -1.0, "jaw"),
    ("lips_together", 0.0, "mouth"),
    ("tongue_raise", -1.0, "mouth"),
    ("tongue_out", 0.0, "mouth"),
    ("sticky_left", 0.0, "mouth"),
    ("sticky_right", 0.0, "mouth"),
    ("jaw_drop", 0.0, "jaw"),
    ("jaw_twist", -1.0, "jaw"),
    ("jaw_clench_left", 0.0, "jaw"),
    ("jaw_clench_right", 0.0, "jaw"),
    ("tongue_sideways", -1.0, "mouth"),
    ("tongue_curl", -1.0, "mouth"),
    ("tongue_wide", -1.0, "mouth"),
    ("tongue_twist", -1.0, "mouth"),
)
LID_PARTS = (
    "lid_upper_middle_*",
    "lid_lower_middle_*",
    "lid_upper_inner_*",
    "lid_upper_outer_*",
    "lid_lower_inner_*",
    "lid_lower_outer_*",
    "crease_height_*",
    "crease_depth_*",
    "crease_inner_*",
    "crease_outer_*",
    "eyebag_*",
    "lid_corner_*",
)
# Lip-curve points, each with x, y, z; numbered from the character's right corner to its left one.
LIP_POINTS = (
    "lip_upper_03",
    "lip_lower_03",
    "lip_corner_left",
    "lip_corner_right",
    "lip_upper_02",
    "lip_upper_04",
    "lip_lower_02",
    "lip_lower_04",
    "lip_upper_01",
    "lip_upper_05",
    "lip_lower_01",
    "lip_lower_05",
)
# Free-form handles, each with x, y, z (name, region).
HANDLES = (
    ("brow_*_02", "brows"),
    ("cheek_*_02", "cheeks"),
    ("chin", "jaw"),
    ("nose_tip", "nose"),
    ("brow_*_01", "brows"),
    ("brow_*_03", "brows"),
    ("cheek_*_01", "cheeks"),
    ("cheek_*_03", "cheeks"),
    ("jaw_*_01", "jaw"),
    ("jaw_*_02", "jaw"),
    ("nose_wing_*", "nose"),
    ("nasolabial_*", "mouth"),
    ("forehead", "brows"),
    ("forehead_*", "brows"),
    ("temple_*", "head"),
    ("ear_*", "ears"),
    ("glabella", "brows"),
    ("nose_bridge", "nose"),
    ("throat", "neck"),
)
WRINKLES = (
    ("wrinkle_forehead_left", "brows"),
    ("wrinkle_forehead_right", "brows"),
    ("wrinkle_glabella", "brows"),
    ("wrinkle_nasolabial_left", "mouth"),
    ("wrinkle_nasolabial_right", "mouth"),
    ("wrinkle_forehead_middle", "brows"),
    ("wrinkle_crow_left", "eye_left"),
    ("wrinkle_crow_right", "eye_right"),
    ("wrinkle_nose_left", "nose"),
    ("wrinkle_nose_right", "nose"),
    ("wrinkle_chin_left", "jaw"),
    ("wrinkle_chin_right", "jaw"),
    ("wrinkle_under_eye_left", "eye_left"),
    ("wrinkle_under_eye_right", "eye_right"),
)
HEAD = (
    "squash",
    "bend_sideways",
    "bend_forward",
    "twist",
    "squash_upper",
    "squash_lower",
    "shape_cranium",
    "shape_jaw_width",
    "shape_cheeks",
    "shape_chin",
    "shape_depth",
    "shape_neck",
)
# Gaze turns the display eyeballs; the lids follow it as far as the follow gains say.
LID_FOLLOW = ("look_y_*", "look_x_*", "follow_upper_*", "follow_lower_*", "follow_aside_*")

# What a creature has beyond a human face (name, lower, region); each pair of frills may be missing from a head.
FRILLS = ("crown", "temple", "cheek", "jaw")
CREATURE = (
    *((f"frill_{name}_raise_*", -1.0, "frills") for name in FRILLS),
    *((f"frill_{name}_spread_*", -1.0, "frills") for name in FRILLS),
    ("ear_spread_*", -1.0, "ears"),
    ("ear_fold_*", 0.0, "ears"),
    ("snarl_*", 0.0, "mouth"),
    ("jowl_*", 0.0, "mouth"),
    ("brow_ridge_*", -1.0, "brows"),
    ("throat_pouch", 0.0, "neck"),
    ("tongue_hump", -1.0, "mouth"),
)


def _expand(names: tuple[tuple[str, str], ...]) -> list[tuple[str, str]]:
    """Expand "*" in (name, region) to both sides."""
    return [
        (name.replace("*", side), region.replace("*", side))
        for name, region in names
        for side in (SIDES if "*" in name else ("",))
    ]


def control_groups() -> dict[str, list[Control]]:
    """Return every control that our face rigs know, by group; a smaller rig has the first ones of each group."""
    eyes = tuple((part, "eye_*") for part in LID_PARTS)
    follow = tuple((part, "eye_*") for part in LID_FOLLOW)
    pairs = [Control(name, 0.0, 0.0, 1.0, region) for name, region in _expand(FACE_PAIRS)]
    singles = [Control(name, lower, 0.0, 1.0, region) for name, lower, region in FACE_SINGLES]
    more = [Control(name, lower, 0.0, 1.0, region) for pair, lower in FACE_MORE for name, region in _expand((pair,))]
    return {
        # The singles stand in the middle, so that a rig with 24 face controls also has chin and lip rolls.
        "face": pairs[:20] + singles + pairs[20:] + more,
        "jaw": [Control(name, lower, 0.0, 1.0, region) for name, lower, region in JAW],
        "lids": [Control(name, -1.0, 0.0, 1.0, region) for name, region in _expand(eyes)],
        "lips": [Control(f"{point}_{axis}", -1.0, 0.0, 1.0, "mouth") for point in LIP_POINTS for axis in AXES],
        "handles": [
            Control(f"handle_{name}_{axis}", -1.0, 0.0, 1.0, region)
            for name, region in _expand(HANDLES)
            for axis in AXES
        ],
        "wrinkles": [Control(name, -1.0, 0.0, 1.0, region) for name, region in WRINKLES],
        "head": [Control(name, -1.0, 0.0, 1.0, "head") for name in HEAD],
        "lid_follow": [Control(name, -1.0, 0.0, 1.0, region) for name, region in _expand(follow)],
        "creature": [
            Control(name, lower, 0.0, 1.0, region)
            for pattern, lower, where in CREATURE
            for name, region in _expand(((pattern, where),))
        ],
    }


def make_controls(counts: Mapping[str, object], source: str = "recipe") -> tuple[Control, ...]:
    """Return a character's controls: the first `counts[group]` of each group.

    counts: group name → number of controls; a group left out has none. source: the file named in error messages.
    Raises InputError for an unknown group, a count out of range, or no controls at all.
    """
    groups = control_groups()
    for group, count in counts.items():
        if group not in groups:
            raise InputError(f"{source}: controls: there is no group '{group}'; there are {', '.join(groups)}")
        most = len(groups[group])
        if isinstance(count, bool) or not isinstance(count, int) or not 0 <= count <= most:
            raise InputError(f"{source}: controls.{group}: expected a whole number from 0 to {most}, got {count!r}")
    controls = tuple(control for group in groups for control in groups[group][: counts.get(group, 0)])
    if not controls:
        raise InputError(f"{source}: controls: a rig needs at least one control, but no group has any")
    return controls


def limit_controls(
    controls: tuple[Control, ...], reach: float, full: Sequence[str], source: str = "recipe"
) -> tuple[Control, ...]:
    """Return the controls with their limits moved towards their defaults, to `reach` (0 to 1) of the distance.

    full: names of those that keep their limits, "*" for both sides. Raises InputError for one that the rig lacks.
    """
    full_names = {name for name, _ in _expand(tuple((name, "") for name in full))}
    unknown = sorted(full_names - {control.name for control in controls})
    if unknown:
        raise InputError(f"{source}: limits.full names '{unknown[0]}', but the rig has no such control")

    def shrink(c: Control) -> Control:
        lower, upper = (c.default + reach * (limit - c.default) for limit in (c.lower, c.upper))
        return replace(c, lower=lower, upper=upper)

    return tuple(control if control.name in full_names else shrink(control) for control in controls)


def control_index(controls: tuple[Control, ...]) -> dict[str, int]:
    """Return each control's column in the parameters p (m,), by name."""
    return {control.name: column for column, control in enumerate(controls)}


def handle_names(controls: tuple[Control, ...]) -> list[str]:
    """Return the free-form handles that have at least one axis among the controls, in order."""
    names = [c.name.removeprefix("handle_")[:-2] for c in controls if c.name.startswith("handle_")]
    return list(dict.fromkeys(names))
