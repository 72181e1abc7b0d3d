"""How a creature's expressions differ from a human face's: ears, frills and the lips along the snout.

Amounts by control; `data_recipes.acting.expressions` lays them over a face's where a rig has a creature's controls.
"""

FRILLS = ("crown", "temple", "cheek", "jaw")


def _frills(lift: float, spread: float) -> dict[str, float]:
    return {f"frill_{name}_raise_*": lift for name in FRILLS} | {f"frill_{name}_spread_*": spread for name in FRILLS}


def _lip_points(wide: float, corners_up: float, middle_up: float, out: float) -> dict[str, float]:
    """Return the lip points that widen a mouth, lift its corners and its middle, and push it forward."""
    ends = {"lip_corner_left": wide, "lip_corner_right": -wide}
    ends |= {f"lip_{lip}_{place}": sign * wide for lip in ("upper", "lower") for place, sign in (("01", -1), ("05", 1))}
    middle = [f"lip_{lip}_{place}" for lip in ("upper", "lower") for place in ("02", "03", "04")]
    points = {f"{name}_x": amount for name, amount in ends.items()}
    points |= {f"lip_corner_{side}_y": corners_up for side in ("left", "right")}
    points |= {f"{name}_y": middle_up for name in middle} | {f"{name}_z": out for name in middle}
    return {name: amount for name, amount in points.items() if amount}


# For rigs with the controls of a creature: ears and frills carry most of an expression, and the mouth is wide.
CREATURE: dict[str, dict[str, float]] = {
    "joy": {"smile_*": 0.95, "ear_raise_*": 0.5, "lid_lower_middle_*": 0.3, **_frills(0.5, 0.2)},
    "laugh": {"ear_raise_*": 0.5, "ear_spread_*": 0.3, **_frills(0.6, 0.4)},
    "grin": {"snarl_*": 0.3, "ear_raise_*": 0.3, **_frills(0.3, 0.2)},
    "smirk": {"snarl_left": 0.35, "ear_raise_right": 0.6, "ear_fold_left": 0.3},
    "anger": {
        "brow_down_*": 1.0,
        "brow_ridge_*": 0.8,
        "lid_upper_inner_*": -1.0,
        "lid_upper_middle_*": -0.4,
        "snarl_*": 0.8,
        "upper_lip_raise_*": 0.25,
        "nose_wrinkle_*": 0.7,
        "wrinkle_nose_*": 0.8,
        "lip_press_*": 0.0,
        "chin_raise": 0.0,
        "jaw_open": 0.1,
        "ear_fold_*": 0.8,
        **_frills(-0.2, 0.9),
    },
    "snarl": {
        "brow_down_*": 1.0,
        "brow_ridge_*": 0.6,
        "lid_upper_inner_*": -0.9,
        "snarl_*": 0.7,
        "upper_lip_raise_*": 0.35,
        "lower_lip_depress_*": 0.1,
        "jowl_*": 0.35,
        "jaw_open": 0.2,
        "ear_fold_*": 1.0,
        **_frills(0.0, 1.0),
    },
    "shout": {
        "jaw_open": 0.95,
        "snarl_*": 0.5,
        "jowl_*": 0.4,
        "lid_upper_inner_*": -0.7,
        "brow_ridge_*": 0.5,
        "throat_pouch": 0.4,
        "tongue_hump": 0.3,
        "ear_fold_*": 0.6,
        **_frills(0.3, 1.0),
    },
    "sadness": {
        "brow_inner_up_*": 1.0,
        "frown_*": 1.0,
        "chin_raise": 0.0,
        "lip_roll_lower": 0.0,
        "lip_press_*": 0.0,
        **_lip_points(-0.3, -1.0, 0.5, 0.0),
        "lid_upper_outer_*": -0.9,
        "lid_upper_inner_*": 0.4,
        "jowl_*": 0.1,
        "ear_fold_*": 0.6,
        "ear_spread_*": 0.5,
        **_frills(-1.0, -0.4),
    },
    "cry": {"lid_upper_outer_*": -0.7, "jowl_*": 0.3, "ear_fold_*": 0.8, **_frills(-0.9, -0.3)},
    "surprise": {"jaw_open": 0.5, "eye_wide_*": 1.0, "ear_raise_*": 1.0, "ear_spread_*": 0.6, **_frills(1.0, 0.7)},
    "shock": {"ear_raise_*": 1.0, "ear_spread_*": 0.9, "throat_pouch": 0.3, **_frills(1.0, 1.0)},
    "fear": {
        "brow_inner_up_*": 1.0,
        "brow_outer_up_*": 0.1,
        "eye_wide_*": 1.0,
        "lid_upper_outer_*": -0.5,
        "frown_*": 0.5,
        "ear_fold_*": 1.0,
        **_frills(-0.6, -0.7),
    },
    "disgust": {
        "nose_wrinkle_*": 1.0,
        "upper_lip_raise_*": 0.5,
        "lower_lip_depress_*": 0.5,
        "brow_down_*": 0.7,
        "blink_*": 0.5,
        "frown_*": 0.6,
        "chin_raise": 0.0,
        "lip_roll_lower": 0.0,
        "mouth_up_down": 0.0,  # or his lower lip would come up through the tongue
        "jaw_open": 0.4,
        "tongue_out": 1.0,
        "tongue_curl": -1.0,
        "ear_fold_*": 0.7,
        **_frills(-0.4, -0.2),
    },
    "contempt": {"snarl_right": 0.5, "brow_ridge_left": 0.4, "ear_fold_*": 0.3, **_frills(-0.2, 0.2)},
    "thinking": {"ear_raise_left": 0.7, "ear_fold_right": 0.4, "frill_temple_raise_left": 0.4},
    "kiss": {
        "pucker_*": 1.0,
        "funnel_*": 0.0,
        "lips_together": 1.0,
        "lip_roll_upper": -0.8,
        "lip_roll_lower": -0.9,
        "ear_raise_*": 0.4,
        **_lip_points(-1.0, 0.0, 0.0, 0.3),
        **_frills(0.3, -0.2),
    },
    "doubt": {"ear_raise_left": 0.6, "ear_fold_right": 0.5, "frill_crown_raise_left": 0.5},
    "sleepy": {"ear_fold_*": 0.5, **_frills(-0.7, -0.3)},
    "yawn": {"tongue_hump": -0.4, "throat_pouch": 0.4, "ear_fold_*": 0.4, **_frills(-0.2, 0.5)},
    "pain": {"snarl_*": 0.6, "jowl_*": 0.4, "ear_fold_*": 0.9, **_frills(-0.3, 0.3)},
    "determined": {"brow_ridge_*": 0.7, "ear_fold_*": 0.4, **_frills(0.0, 0.4)},
    "puffed": {"throat_pouch": 1.0, **_frills(0.3, 0.5)},
    "gulp": {"throat_pouch": 0.7, "tongue_hump": 0.5, **_frills(-0.3, -0.2)},
    "tease": {
        "tongue_out": 1.0,
        "tongue_hump": 0.0,
        "jaw_open": 0.45,
        "lower_lip_depress_*": 0.5,
        "ear_raise_right": 0.6,
        "ear_fold_left": 0.3,
        **_frills(0.4, 0.3),
    },
    "sniff": {"ear_spread_*": 0.3, "brow_ridge_*": -0.4, **_frills(0.3, 0.2)},
    "plead": {"lid_upper_outer_*": -0.4, "ear_fold_*": 0.6, "ear_spread_*": 0.4, **_frills(-0.7, -0.3)},
}
