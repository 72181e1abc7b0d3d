"""The 54 landmarks of a face that performance capture tracks (§5.3.2), by name, and the region that each belongs to.

The paper uses 54 of the 68 landmarks that face trackers are trained on (Multi-PIE, 300-W) and doesn't say which. Ours
leave out the outline of the jaw, except the chin and a point on each side of it.
"""

FACE_LANDMARKS = {  # name → its number among the 68, from 0; "right" is the character's right, left in the picture
    "chin_right": 7,
    "chin": 8,
    "chin_left": 9,
    "brow_right_5": 17,
    "brow_right_4": 18,
    "brow_right_3": 19,
    "brow_right_2": 20,
    "brow_right_1": 21,
    "brow_left_1": 22,
    "brow_left_2": 23,
    "brow_left_3": 24,
    "brow_left_4": 25,
    "brow_left_5": 26,
    "nose_bridge_1": 27,
    "nose_bridge_2": 28,
    "nose_bridge_3": 29,
    "nose_tip": 30,
    "nose_wing_right": 31,
    "nostril_right": 32,
    "nose_base": 33,
    "nostril_left": 34,
    "nose_wing_left": 35,
    "eye_right_outer": 36,
    "eye_right_upper_2": 37,
    "eye_right_upper_1": 38,
    "eye_right_inner": 39,
    "eye_right_lower_1": 40,
    "eye_right_lower_2": 41,
    "eye_left_inner": 42,
    "eye_left_upper_1": 43,
    "eye_left_upper_2": 44,
    "eye_left_outer": 45,
    "eye_left_lower_2": 46,
    "eye_left_lower_1": 47,
    "mouth_corner_right": 48,
    "lip_upper_right_2": 49,
    "lip_upper_right_1": 50,
    "lip_upper": 51,
    "lip_upper_left_1": 52,
    "lip_upper_left_2": 53,
    "mouth_corner_left": 54,
    "lip_lower_left_2": 55,
    "lip_lower_left_1": 56,
    "lip_lower": 57,
    "lip_lower_right_1": 58,
    "lip_lower_right_2": 59,
    "seam_corner_right": 60,
    "seam_upper_right": 61,
    "seam_upper": 62,
    "seam_upper_left": 63,
    "seam_corner_left": 64,
    "seam_lower_left": 65,
    "seam_lower": 66,
    "seam_lower_right": 67,
}
TELLING_SHAPES = ("eyeBlinkLeft", "eyeBlinkRight", "jawOpen")  # by what these move, landmarks are found on any face
_REGIONS = {
    "chin": "jaw",
    "brow": "brows",
    "nos": "nose",
    "eye_right": "eye_right",
    "eye_left": "eye_left",
    "mouth": "mouth",
    "lip": "mouth",
    "seam": "mouth",
}


def region_of_landmark(name: str) -> str:
    """Return the region of the face that a landmark of `FACE_LANDMARKS` belongs to."""
    return next(region for start, region in _REGIONS.items() if name.startswith(start))
