"""The acting of the Rigify face: expressions as moves of its controls, and clips in which they follow one another.

This runs in Blender's Python too and needs numpy only. Moves are millimetres on a face whose eyes are 67 mm apart, in
the axes of our heads (x to the face's left, y up, z forward); turns are degrees about these axes. A name with ".L"
stands for both sides, and the right one mirrors the left one.
"""

from __future__ import annotations

import numpy as np

Pose = dict[str, np.ndarray]  # control → its move (3,), or for "<control>:turn" its turn (3,)

EXPRESSIONS: dict[str, dict[str, tuple[float, float, float]]] = {
    "smile": {
        "lips.L": (7, 6, -4),
        "lip.T.L.001": (3, 2, -1),
        "lip.B.L.001": (3, 1, -1),
        "lip.T": (0, 0.5, -1),
        "cheek.B.L.001": (2, 4, 2),
        "cheek.T.L.001": (1, 3, 1),
        "lid.B.L.002": (0, 1.5, 0),
    },
    "grin": {
        "lips.L": (8, 3, -3),
        "lip.T.L.001": (3, 4, 0),
        "lip.B.L.001": (4, -3, 0),
        "lip.T": (0, 3, 0),
        "lip.B": (0, -3, 0),
        "cheek.B.L.001": (2, 3, 2),
    },
    "open": {
        "jaw_master:turn": (18, 0, 0),
        "jaw_master": (0, 0, 8),
        "lip.B.L.001": (2, -2, 0),
        "lip.T.L.001": (1, 1, 0),
        "lips.L": (-1, -1, 0),
    },
    "part": {"jaw_master:turn": (8, 0, 0), "jaw_master": (0, 0, 3)},
    "pucker": {
        "lips.L": (-5, 0, 3),
        "lip.T.L.001": (-1, 0.5, 3.5),
        "lip.B.L.001": (-1, -0.5, 3.5),
        "lip.T": (0, 1, 4),
        "lip.B": (0, -1, 4),
    },
    "round": {
        "jaw_master:turn": (9, 0, 0),
        "lips.L": (-4.5, 0, 2.5),
        "lip.T.L.001": (-1, 0.5, 3),
        "lip.B.L.001": (-1, -0.5, 3),
        "lip.T": (0, 1, 3.5),
        "lip.B": (0, -1, 3.5),
    },
    "stretch": {"lips.L": (7, -1, -3), "lip.T.L.001": (2, 1, 0), "lip.B.L.001": (3, -2, 0), "lip.B": (0, -2, 0)},
    "press": {"lip.T": (0, -0.5, -2), "lip.B": (0, 0.5, -2), "lips.L": (2, 0, -1), "chin": (0, 1.5, 1)},
    "bite": {"lip.B": (0, 2, -4), "lip.B.L.001": (0, 1, -3), "lip.T": (0, 1.5, 0), "jaw_master:turn": (2, 0, 0)},
    "frown": {"lips.L": (1, -6, -1), "lip.B": (0, 1, 1), "chin": (0, 2, 1.5), "cheek.B.L.001": (0, -2, 0)},
    "sneer": {
        "lip.T": (0, 3, 0),
        "lip.T.L.001": (0, 4, 0.5),
        "nose.L.001": (1, 3, 0),
        "nose.L": (0, 2, 0.5),
        "cheek.T.L.001": (0, 3, 1),
        "brow.T.L.003": (-1, -4, 1),
        "lid.B.L.002": (0, 1.5, 0),
    },
    "snarl": {"lip.T.L.001": (1, 5, 1), "nose.L.001": (1, 3, 0), "lip.B.L.001": (1, -4, 0), "lip.B": (0, -4, 0)},
    "brows_up": {
        "brow.T.L.001": (0, 3, 0),
        "brow.T.L.002": (0, 4.5, 0),
        "brow.T.L.003": (0, 4, 0),
        "brow.B.L.001": (0, 1.5, 0),
        "brow.B.L.002": (0, 2, 0),
        "brow.B.L.003": (0, 2, 0),
    },
    "brows_worry": {"brow.T.L.003": (-1.5, 4.5, 0.5), "brow.T.L.002": (-1, 1, 0), "brow.T.L.001": (0, -2, 0)},
    "brows_down": {
        "brow.T.L.001": (0, -2, 0),
        "brow.T.L.002": (-2, -5, 1),
        "brow.T.L.003": (-4, -6, 1.5),
        "brow.B.L.002": (0, -2, 1),
        "brow.B.L.003": (-1, -2.5, 1),
        "nose": (0, -1, 0.5),
    },
    "wide_eyes": {"lid.T.L.002": (0, 2.5, 0), "lid.B.L.002": (0, -1.5, 0), "brow.T.L.002": (0, 3, 0)},
    "squint": {
        "lid.B.L.002": (0, 3, 0),
        "lid.B.L.001": (0, 1, 0),
        "lid.B.L.003": (0, 1, 0),
        "cheek.T.L.001": (0, 2, 1),
    },
    "flare": {"nose.L.001": (2, 0.5, 0), "nose.002": (0, 1, 0)},
    "wrinkle": {"nose_master": (0, 2, 0), "nose.L": (0, 2, 0.5), "brow.T.L.003": (-1, -3, 0.5)},
    "puff": {
        "cheek.B.L.001": (5, 0, 5),
        "lips.L": (-2, 0, 1),
        "lip.T": (0, 0, 1),
        "lip.B": (0, 0, 1),
        "chin.L": (3, 0, 2),
    },
    "suck": {"cheek.B.L.001": (-4, 0, -4), "lips.L": (-3, 0, 1)},
    "chin_up": {"chin": (0, 3, 1), "lip.B": (0, 2, 2), "chin.001": (0, 1, 1)},
    "jaw_left": {"jaw_master": (5, 0, 0)},
    "jaw_right": {"jaw_master": (-5, 0, 0)},
    "jaw_forward": {"jaw_master": (0, -1, 5)},
    "tongue_up": {"tongue": (0, 4, 1), "jaw_master:turn": (7, 0, 0)},
    "tongue_out": {"tongue_master": (0, 1, 9), "tongue": (0, 0, 4), "jaw_master:turn": (13, 0, 0), "lip.B": (0, -1, 1)},
    "look_left": {"eyes": (35, 0, 0)},
    "look_right": {"eyes": (-35, 0, 0)},
    "look_up": {"eyes": (0, 22, 0), "lid.T.L.002": (0, 1, 0)},
    "look_down": {"eyes": (0, -25, 0), "lid.T.L.002": (0, -2, 0)},
    "ears_back": {"ear.L": (0, 2, -2)},
}
FEELINGS = {  # of takes: expressions and their amounts
    "joy": {"smile": 1.0, "squint": 0.6, "grin": 0.4, "part": 0.5},
    "laughter": {"smile": 0.8, "grin": 0.5, "open": 0.8, "squint": 1.0, "brows_up": 0.3},
    "surprise": {"brows_up": 1.0, "wide_eyes": 1.0, "open": 0.7},
    "fear": {"brows_worry": 1.0, "brows_up": 0.5, "wide_eyes": 1.0, "stretch": 0.9, "part": 0.8},
    "anger": {"brows_down": 1.0, "squint": 0.4, "press": 0.8, "flare": 1.0},
    "rage": {"brows_down": 1.0, "snarl": 0.8, "open": 0.6, "wrinkle": 0.8, "flare": 1.0},
    "disgust": {"sneer": 1.0, "wrinkle": 0.8, "squint": 0.6, "frown": 0.3},
    "grief": {"brows_worry": 1.0, "frown": 1.0, "chin_up": 0.7, "squint": 0.4, "look_down": 0.6},
    "doubt": {"chin_up": 0.8, "frown": 0.5, "brows_down": 0.4, "look_left": 0.5},
    "kiss": {"pucker": 1.0, "squint": 0.3},
    "whistle": {"round": 0.7, "pucker": 0.6, "brows_up": 0.4, "suck": 0.5},
    "effort": {"press": 0.8, "puff": 0.9, "brows_down": 0.6, "squint": 0.7},
    "cheek": {"tongue_out": 1.0, "squint": 0.8, "smile": 0.4},
    "shout": {"open": 1.0, "brows_down": 0.6, "stretch": 0.5, "flare": 0.6},
    "yawn": {"open": 1.2, "squint": 0.8, "brows_up": 0.4, "round": 0.3},
}
SOUNDS = {  # mouth shapes of speech
    "aa": {"open": 0.65},
    "ee": {"stretch": 0.7, "part": 0.5},
    "oh": {"round": 0.9, "open": 0.2},
    "oo": {"pucker": 0.8, "part": 0.3},
    "mm": {"press": 0.7},
    "ff": {"bite": 0.9},
    "ll": {"tongue_up": 0.9},
    "ss": {"grin": 0.35, "part": 0.2},
}
TAKES, TAKES_FOR_ALL, SPEECHES = 10, 5, 8  # all feelings come in five takes, and once more in the next five
SPEECH_FRAMES = (3, 6)  # from key to key
TAKE_FRAMES = (7, 16)


def expression_pose(amounts: dict[str, float], lids: Pose, sides: tuple[float, float] = (1.0, 1.0)) -> Pose:
    """Return the moves and turns of a mixture of expressions.

    amounts: by expression, or "blink".
    lids: the moves of a blink.
    sides: the strengths of the left and of the right side, for controls that stand on one.
    """
    pose: Pose = {}
    for name, amount in amounts.items():
        for control, move in (lids if name == "blink" else EXPRESSIONS[name]).items():
            for copy, mirror, strength in _copies(control, sides):
                part = amount * strength * np.asarray(move, float) * mirror
                pose[copy] = pose.get(copy, 0.0) + part
    return pose


def _copies(control: str, sides: tuple[float, float]) -> list[tuple[str, np.ndarray, float]]:
    """Return a control, or both of a pair, each with the signs of its axes and its strength."""
    as_is = np.ones(3)
    if ".L" not in control:
        return [(control, as_is, 1.0)]
    mirror = np.array([1.0, -1, -1]) if control.endswith(":turn") else np.array([-1.0, 1, 1])
    return [(control, as_is, sides[0]), (control.replace(".L", ".R", 1), mirror, sides[1])]


def clips(seed: int, fine: list[str], lids: Pose) -> dict[str, list[tuple[int, Pose]]]:
    """Return the animation, clip → (frame, pose) of its keys; Blender eases between them.

    fine: controls that are nudged at random too, so that the animation uses all controls.
    lids: the moves of a blink.
    """
    generator = np.random.default_rng(seed)
    keys = {}
    for round_of_takes in range(TAKES // TAKES_FOR_ALL):
        names = [str(name) for name in generator.permutation(list(FEELINGS))]
        for k in range(TAKES_FOR_ALL):
            name = f"take_{round_of_takes * TAKES_FOR_ALL + k + 1}"
            keys[name] = _take(generator, names[k::TAKES_FOR_ALL], fine, lids)
    for k in range(SPEECHES):
        keys[f"speech_{k + 1}"] = _speech(generator, fine, lids)
    keys["exercise"] = _exercise(generator, lids)
    return keys


def _nudge(generator: np.random.Generator, pose: Pose, fine: list[str]) -> Pose:
    """Return a pose with a sixth of the fine controls moved by about a millimetre."""
    pose = dict(pose)
    for control in generator.permutation(fine)[: max(1, len(fine) // 6)]:
        pose[control] = pose.get(control, 0.0) + generator.normal(0.0, 1.0, 3)
    return pose


def _sides(generator: np.random.Generator) -> tuple[float, float]:
    left, right = 1.0 + generator.uniform(-0.35, 0.2, 2)
    return float(left), float(right)


def _take(generator: np.random.Generator, feelings: list[str], fine: list[str], lids: Pose) -> list[tuple[int, Pose]]:
    """Return the keys of a take: feelings come, are held for a while and change, with blinks between them."""
    frame, keys = 1, [(1, {})]
    for feeling in [f for f in feelings for _ in range(2)]:
        sides, amount = _sides(generator), generator.uniform(0.6, 1.15)
        amounts = {name: amount * value for name, value in FEELINGS[feeling].items()}
        frame += int(generator.integers(*TAKE_FRAMES))
        keys.append((frame, _nudge(generator, expression_pose(amounts, lids, sides), fine)))
        frame += int(generator.integers(4, 10))
        held = {name: value * generator.uniform(0.7, 1.1) for name, value in amounts.items()}
        keys.append((frame, _nudge(generator, expression_pose(held, lids, sides), fine)))
        frame += 3
        gaze = str(generator.choice(["look_left", "look_right", "look_up", "look_down"]))
        half = {name: 0.5 * value for name, value in amounts.items()} | {"blink": 1.0, gaze: 0.6}
        keys.append((frame, expression_pose(half, lids)))
    return [*keys, (frame + 8, {})]


def _speech(generator: np.random.Generator, fine: list[str], lids: Pose) -> list[tuple[int, Pose]]:
    """Return the keys of a speech: invented syllables in a mood, with accents of brows and eyes, and blinks."""
    frame, keys, mood = 1, [(1, {})], str(generator.choice(list(FEELINGS)))
    calm = {name: 0.25 * value for name, value in FEELINGS[mood].items() if name not in ("open", "round", "tongue_out")}
    for syllable in range(24):
        frame += int(generator.integers(*SPEECH_FRAMES))
        sound = SOUNDS[str(generator.choice(list(SOUNDS)))]
        amounts = dict(calm)
        for name, value in sound.items():
            amounts[name] = amounts.get(name, 0.0) + value * generator.uniform(0.7, 1.2)
        accent = str(generator.choice(["brows_up", "brows_worry", "brows_down", "look_left", "look_right"]))
        amounts[accent] = amounts.get(accent, 0.0) + generator.uniform(0.0, 0.6)
        if syllable % 6 == 5:
            amounts["blink"] = 1.0
        keys.append((frame, _nudge(generator, expression_pose(amounts, lids, _sides(generator)), fine)))
    return [*keys, (frame + 6, {})]


def _exercise(generator: np.random.Generator, lids: Pose) -> list[tuple[int, Pose]]:
    """Return the keys of an exercise, as riggers test a rig: each expression alone and strong, and a blink."""
    frame, keys = 1, [(1, {})]
    for name in [*EXPRESSIONS, "blink"]:
        amount = 1.0 if name == "blink" else generator.uniform(0.9, 1.2)
        keys.append((frame + 5, expression_pose({name: amount}, lids)))
        keys.append((frame + 9, {}))
        frame += 9
    return keys
