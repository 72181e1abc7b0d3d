"""What a face does: expressions and visemes as amounts of the named controls.

"*" stands for both sides. Amounts are those of a full but not extreme performance; `data_recipes.animation` scales
them, makes them uneven and lets a smaller rig leave out the controls that it lacks. What faces do together stands
together here: a smile lifts the cheeks and narrows the eyes, a cry opens the jaw and squares the lower lip.
"""

EXPRESSIONS: dict[str, dict[str, float]] = {
    "joy": {
        "smile_*": 0.85, "cheek_raise_*": 0.6, "squint_*": 0.35, "brow_outer_up_*": 0.15, "dimple_*": 0.2,
        "wrinkle_crow_*": 0.5, "wrinkle_nasolabial_*": 0.4, "wrinkle_under_eye_*": 0.4, "ear_raise_*": 0.2,
        "eyebag_*": 0.3,
    },
    "laugh": {
        "smile_*": 0.9, "jaw_open": 0.55, "cheek_raise_*": 0.85, "squint_*": 0.6, "upper_lip_raise_*": 0.35,
        "lower_lip_depress_*": 0.25, "brow_outer_up_*": 0.3, "nose_wrinkle_*": 0.2, "nostril_flare_*": 0.3,
        "wrinkle_crow_*": 0.8, "wrinkle_nasolabial_*": 0.7, "bend_forward": -0.15, "squash": 0.07, "ear_raise_*": 0.3,
        "tongue_raise": -0.2,
    },
    "grin": {
        "smile_*": 0.7, "mouth_stretch_*": 0.5, "upper_lip_raise_*": 0.45, "lower_lip_depress_*": 0.5,
        "cheek_raise_*": 0.4, "squint_*": 0.2, "dimple_*": 0.5, "jaw_forward": 0.2,
    },
    "smirk": {
        "smile_left": 0.8, "dimple_left": 0.7, "cheek_raise_left": 0.45, "squint_left": 0.4, "brow_outer_up_right": 0.5,
        "mouth_sideways": 0.35, "lip_press_right": 0.3, "wrinkle_nasolabial_left": 0.5, "bend_sideways": 0.1,
    },
    "anger": {
        "brow_down_*": 0.85, "brow_squeeze_*": 0.8, "squint_*": 0.45, "nose_wrinkle_*": 0.3, "nostril_flare_*": 0.6,
        "lip_press_*": 0.6, "frown_*": 0.4, "chin_raise": 0.35, "jaw_clench_*": 0.6, "neck_tighten_*": 0.3,
        "wrinkle_glabella": 0.7, "jaw_forward": 0.3, "ear_raise_*": 0.15, "wrinkle_chin_*": 0.3, "bend_forward": 0.1,
    },
    "snarl": {
        "brow_down_*": 0.75, "brow_squeeze_*": 0.7, "nose_wrinkle_*": 0.85, "upper_lip_raise_*": 0.85,
        "lower_lip_depress_*": 0.35, "squint_*": 0.55, "nostril_flare_*": 0.5, "jaw_open": 0.12, "mouth_stretch_*": 0.3,
        "wrinkle_nose_*": 0.8, "wrinkle_nasolabial_*": 0.5, "neck_tighten_*": 0.4, "jaw_clench_*": 0.3,
    },
    "shout": {
        "jaw_open": 0.8, "jaw_drop": 0.3, "brow_down_*": 0.7, "brow_squeeze_*": 0.6, "mouth_stretch_*": 0.45,
        "upper_lip_raise_*": 0.55, "lower_lip_depress_*": 0.6, "nose_wrinkle_*": 0.4, "squint_*": 0.4,
        "neck_tighten_*": 0.8, "squash": -0.12, "bend_forward": -0.12, "tongue_raise": -0.4, "tongue_wide": 0.2,
        "jaw_forward": 0.2,
    },
    "sadness": {
        "brow_inner_up_*": 0.8, "brow_squeeze_*": 0.5, "frown_*": 0.75, "chin_raise": 0.45, "blink_*": 0.2,
        "lip_press_*": 0.2, "wrinkle_forehead_middle": 0.6, "wrinkle_chin_*": 0.5, "bend_forward": 0.15,
        "lip_roll_lower": 0.2, "crease_inner_*": 0.3, "mouth_up_down": -0.2,
    },
    "cry": {
        "brow_inner_up_*": 0.7, "brow_down_*": 0.35, "brow_squeeze_*": 0.8, "squint_*": 0.85, "blink_*": 0.35,
        "frown_*": 0.6, "mouth_stretch_*": 0.6, "jaw_open": 0.35, "lower_lip_depress_*": 0.5, "cheek_raise_*": 0.6,
        "upper_lip_raise_*": 0.25, "chin_raise": 0.3, "neck_tighten_*": 0.5, "wrinkle_glabella": 0.5, "sticky_*": 0.6,
        "wrinkle_crow_*": 0.3,
    },
    "surprise": {
        "brow_inner_up_*": 0.8, "brow_outer_up_*": 0.85, "eye_wide_*": 0.75, "jaw_open": 0.4, "funnel_*": 0.2,
        "scalp_raise": 0.5, "wrinkle_forehead_*": 0.7, "ear_raise_*": 0.3, "squash": -0.15, "crease_height_*": 0.3,
    },
    "shock": {
        "brow_inner_up_*": 0.9, "brow_outer_up_*": 0.95, "eye_wide_*": 0.95, "jaw_open": 0.85, "jaw_drop": 0.5,
        "funnel_*": 0.4, "scalp_raise": 0.8, "squash": -0.3, "squash_lower": -0.2, "wrinkle_forehead_*": 0.9,
        "neck_tighten_*": 0.3, "shape_cranium": 0.2,
    },
    "fear": {
        "brow_inner_up_*": 0.85, "brow_outer_up_*": 0.35, "brow_squeeze_*": 0.55, "eye_wide_*": 0.85,
        "mouth_stretch_*": 0.7, "lower_lip_depress_*": 0.3, "jaw_open": 0.2, "neck_tighten_*": 0.7,
        "wrinkle_forehead_middle": 0.5, "nostril_flare_*": 0.4, "bend_forward": -0.12, "scalp_raise": 0.3,
        "twist": -0.07,
    },
    "disgust": {
        "nose_wrinkle_*": 0.9, "upper_lip_raise_*": 0.7, "brow_down_*": 0.5, "squint_*": 0.5, "frown_*": 0.35,
        "chin_raise": 0.5, "nose_up_down": 0.4, "lip_roll_lower": -0.3, "tongue_out": 0.1, "wrinkle_nose_*": 0.8,
        "cheek_raise_*": 0.3, "wrinkle_nasolabial_*": 0.5, "twist": 0.1, "jaw_sideways": 0.1,
    },
    "contempt": {
        "dimple_right": 0.8, "smile_right": 0.35, "lip_press_*": 0.4, "brow_outer_up_right": 0.6,
        "brow_down_left": 0.35, "squint_*": 0.3, "blink_*": 0.15, "chin_raise": 0.25, "bend_forward": -0.15,
        "mouth_sideways": -0.3, "wrinkle_nasolabial_right": 0.6, "wrinkle_forehead_right": 0.4, "nose_up_down": 0.2,
    },
    "thinking": {
        "brow_squeeze_*": 0.4, "brow_down_left": 0.45, "brow_outer_up_right": 0.55, "lip_press_*": 0.35,
        "mouth_sideways": 0.6, "pucker_left": 0.4, "pucker_right": 0.25, "squint_*": 0.3, "look_y_*": 0.6,
        "look_x_*": 0.5, "bend_sideways": -0.15, "wrinkle_glabella": 0.3,
    },
    "kiss": {
        "pucker_*": 0.95, "funnel_*": 0.35, "lips_together": 0.3, "blink_*": 0.5, "cheek_puff_*": 0.1,
        "brow_inner_up_*": 0.35, "jaw_forward": 0.25, "mouth_up_down": 0.1, "bend_forward": 0.12,
    },
    "pout": {
        "lip_roll_lower": -0.7, "chin_raise": 0.8, "frown_*": 0.5, "pucker_*": 0.3, "brow_inner_up_*": 0.5,
        "brow_down_*": 0.2, "wrinkle_chin_*": 0.7, "lip_roll_upper": -0.2, "bend_forward": 0.12,
    },
    "doubt": {
        "brow_outer_up_left": 0.75, "brow_inner_up_left": 0.4, "brow_down_right": 0.5, "frown_*": 0.35,
        "lip_press_*": 0.3, "chin_raise": 0.3, "squint_right": 0.4, "twist": -0.15, "jaw_sideways": -0.25,
        "wrinkle_forehead_left": 0.7, "mouth_sideways": -0.25,
    },
    "sleepy": {
        "blink_*": 0.6, "brow_outer_up_*": 0.3, "jaw_open": 0.1, "jaw_drop": 0.2, "frown_*": 0.15, "eyebag_*": 0.5,
        "bend_sideways": 0.17, "bend_forward": 0.15, "crease_depth_*": -0.3,
    },
    "yawn": {
        "jaw_open": 0.9, "jaw_drop": 0.4, "blink_*": 0.85, "brow_inner_up_*": 0.5, "brow_outer_up_*": 0.4,
        "nostril_flare_*": 0.5, "tongue_raise": -0.5, "tongue_curl": 0.4, "neck_tighten_*": 0.4, "squash": -0.17,
        "squash_lower": -0.15, "ear_raise_*": 0.3, "nose_up_down": -0.2, "funnel_*": 0.2,
    },
    "pain": {
        "squint_*": 0.9, "blink_*": 0.4, "brow_down_*": 0.7, "brow_squeeze_*": 0.8, "cheek_raise_*": 0.8,
        "upper_lip_raise_*": 0.6, "mouth_stretch_*": 0.7, "lower_lip_depress_*": 0.4, "jaw_clench_*": 0.8,
        "nose_wrinkle_*": 0.6, "wrinkle_crow_*": 0.6, "wrinkle_glabella": 0.6, "neck_tighten_*": 0.6, "squash": 0.15,
        "bend_sideways": 0.1,
    },
    "determined": {
        "brow_down_*": 0.6, "brow_squeeze_*": 0.3, "lip_press_*": 0.75, "chin_raise": 0.4, "jaw_clench_*": 0.7,
        "nostril_flare_*": 0.3, "jaw_forward": 0.45, "squint_*": 0.3, "lip_roll_upper": 0.3, "lip_roll_lower": 0.3,
        "shape_jaw_width": 0.2,
    },
    "puffed": {
        "cheek_puff_*": 0.9, "lip_press_*": 0.6, "eye_wide_*": 0.4, "brow_outer_up_*": 0.5, "pucker_*": 0.25,
        "lips_together": 0.4, "squash": 0.1, "shape_cheeks": 0.3, "lip_roll_upper": 0.3, "lip_roll_lower": 0.3,
    },
    "gulp": {
        "throat_swallow": 0.9, "lip_press_*": 0.6, "mouth_stretch_*": 0.3, "brow_inner_up_*": 0.6, "eye_wide_*": 0.4,
        "chin_raise": 0.3, "tongue_raise": 0.4, "neck_tighten_*": 0.4, "jaw_drop": 0.15, "mouth_up_down": 0.2,
    },
    "tease": {
        "tongue_out": 0.9, "jaw_open": 0.3, "tongue_wide": 0.3, "tongue_curl": -0.4, "squint_left": 0.6,
        "blink_left": 0.5, "smile_*": 0.4, "nose_wrinkle_*": 0.4, "bend_sideways": 0.17, "tongue_sideways": 0.3,
        "brow_outer_up_right": 0.4, "tongue_twist": 0.2, "brow_down_left": 0.3,
    },
    "whistle": {
        "pucker_*": 0.85, "funnel_*": 0.6, "cheek_puff_*": 0.25, "brow_outer_up_*": 0.4, "jaw_open": 0.06,
        "dimple_*": 0.3, "look_y_*": 0.4, "lip_roll_upper": -0.2, "lip_roll_lower": -0.2,
    },
    "chew": {
        "jaw_sideways": 0.6, "jaw_twist": 0.5, "jaw_open": 0.18, "lips_together": 0.6, "cheek_puff_left": 0.5,
        "jaw_clench_right": 0.6, "mouth_sideways": 0.3, "lip_press_*": 0.3, "tongue_sideways": 0.6,
        "tongue_twist": 0.4, "cheek_raise_left": 0.2,
    },
    "sniff": {
        "nose_up_down": 0.7, "nose_wrinkle_*": 0.4, "nostril_flare_*": 0.8, "upper_lip_raise_*": 0.2,
        "mouth_up_down": 0.5, "brow_inner_up_*": 0.3, "scalp_raise": -0.4, "lip_press_*": 0.3, "wrinkle_nose_*": 0.3,
    },
    "plead": {
        "brow_inner_up_*": 0.95, "brow_squeeze_*": 0.4, "eye_wide_*": 0.5, "frown_*": 0.35, "lip_roll_lower": -0.25,
        "jaw_open": 0.08, "look_y_*": 0.35, "bend_forward": 0.17, "chin_raise": 0.25, "wrinkle_forehead_middle": 0.7,
        "lid_lower_middle_*": 0.3, "bend_sideways": -0.1,
    },
    "bored": {
        "blink_*": 0.4, "brow_outer_up_*": 0.25, "mouth_sideways": -0.5, "cheek_puff_right": 0.35, "frown_*": 0.25,
        "jaw_sideways": -0.35, "look_x_*": -0.5, "bend_sideways": -0.2, "squash_upper": 0.1, "jaw_twist": -0.3,
    },
}

# Mouth shapes of speech. How strongly each insists on itself is in `data_recipes.speech`.
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
