"""Mouth shapes of speech: amounts of the named controls. How strongly each insists on itself is in `speech`."""

VISEMES: dict[str, dict[str, float]] = {
    "rest": {},
    "ah": {"jaw_open": 0.5, "lower_lip_depress_*": 0.2, "upper_lip_raise_*": 0.1, "tongue_raise": -0.2},
    "eh": {"jaw_open": 0.32, "mouth_stretch_*": 0.3, "lower_lip_depress_*": 0.25, "smile_*": 0.1, "tongue_wide": 0.1},
    "ee": {"jaw_open": 0.14, "mouth_stretch_*": 0.5, "smile_*": 0.25, "lower_lip_depress_*": 0.2, "tongue_raise": 0.3},
    "oh": {"jaw_open": 0.38, "funnel_*": 0.6, "pucker_*": 0.25, "tongue_curl": -0.2},
    "oo": {"jaw_open": 0.12, "pucker_*": 0.75, "funnel_*": 0.4, "mouth_up_down": 0.05},
    "mbp": {"lips_together": 0.8, "lip_press_*": 0.5, "lip_roll_upper": 0.2, "lip_roll_lower": 0.25, "jaw_open": 0.04},
    "fv": {"lip_roll_lower": 0.6, "upper_lip_raise_*": 0.25, "jaw_open": 0.06, "lip_press_*": 0.1},
    "th": {"jaw_open": 0.16, "tongue_out": 0.45, "tongue_raise": 0.3, "lower_lip_depress_*": 0.15},
    "tdnl": {"jaw_open": 0.14, "tongue_raise": 0.75, "tongue_curl": 0.3, "lower_lip_depress_*": 0.15},
    "kg": {"jaw_open": 0.2, "tongue_raise": -0.4, "tongue_curl": -0.5, "mouth_stretch_*": 0.1, "throat_swallow": 0.1},
    "sz": {"jaw_open": 0.05, "mouth_stretch_*": 0.25, "lower_lip_depress_*": 0.35, "upper_lip_raise_*": 0.15},
    "sh": {"jaw_open": 0.08, "funnel_*": 0.55, "pucker_*": 0.3, "upper_lip_raise_*": 0.2, "tongue_wide": -0.2},
    "r": {"jaw_open": 0.12, "pucker_*": 0.35, "funnel_*": 0.25, "tongue_curl": 0.6, "sticky_*": 0.1},
}
