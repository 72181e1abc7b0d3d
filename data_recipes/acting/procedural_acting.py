"""Procedural acting: the animation A that a film character would come with (§3.5, §5.1).

A film rig is driven by shots that animators keyed. Ours are invented, from the settings and the seed of the character:
expressions that ease into each other with anticipation, overshoot and overlap; speech in invented syllables; blinks,
and gaze with the lids following it; uneven faces; squash and stretch on the accents; nudges of the fine controls on
the key poses; and holds, in which nothing moves at all, so that poses recur as they do in real animation.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from data_recipes.acting import speech
from data_recipes.acting.arkit_names import in_their_words, name_pairs
from data_recipes.acting.expressions import EXPRESSIONS, expression
from data_recipes.acting.motion import FRAMES_PER_SECOND, blink_profile, drift, freeze, move_keys, pose, through
from data_recipes.controls import Control, control_groups
from replicate.base.schema import Checked, number


@dataclass(frozen=True)
class Acting(Checked):
    """How a character acts. Shares are of a full performance; times are in seconds."""

    seed: int = number(1, 0, 2**31)
    clips: int = number(40, 0, 1000)
    clip_s: float = number(8.5, 1.0, 120.0)  # mean length
    tempo: float = number(1.0, 0.3, 3.0)
    intensity: float = number(1.0, 0.05, 1.5)
    asymmetry: float = number(0.2, 0.0, 1.0)
    anticipation: float = number(0.08, 0.0, 0.5)
    overshoot: float = number(0.12, 0.0, 0.5)
    polish: float = number(0.32, 0.0, 1.0)
    hand: int = number(6, 0, 20)  # families of fine controls polished in a shot
    holds: float = number(0.45, 0.0, 1.0)  # share of key poses on which everything stands still for a while
    blinks_per_minute: float = number(16.0, 0.0, 120.0)
    dialogues: int = number(3, 0, 3)  # of ten shots; for each one less than three there is one more take


# The kinds of shots: how many of ten are of this kind, and how they are played.
KINDS = {
    "emotion": {"share": 4, "gain": 1.0, "move": (7, 15), "stay": (3, 12)},
    "dialogue": {"share": 3, "gain": 0.55, "move": (8, 16), "stay": (14, 36)},
    "take": {"share": 2, "gain": 1.15, "move": (6, 10), "stay": (4, 12)},
    "exercise": {"share": 1, "gain": 1.0, "move": (6, 10), "stay": (2, 6)},
}
DECIMALS = 4  # of a value; unrounded, poses at rest would differ by rounding errors
# Beginning of a control's name → by how many frames it drags behind; 1 for all others.
LAGS = {
    "frill": 5,
    "throat_pouch": 3,
    "brow": 0,
    "eye": 0,
    "blink": 0,
    "lid": 0,
    "ear": 4,
    "handle": 2,
    "shape": 3,
    "neck": 2,
    "scalp": 2,
}
BREATHING = ("bend_sideways", "bend_forward", "twist", "brow_inner_up_*", "nostril_flare_*", "neck_tighten_*")
MOUTH = ("smile", "frown", "pucker", "upper_lip", "lower_lip", "mouth", "dimple", "funnel", "lip", "jaw", "tongue")


def act(controls: Sequence, acting: Acting) -> list[tuple[str, np.ndarray]]:
    """Return a character's clips: (name, (t, m) float32 at 24 frames a second), within the controls' limits.

    controls: the rig's controls in the order of p, each with name, lower, default and upper; the performance leaves out
    those that a smaller rig lacks. The same arguments give the same clips, to the last bit.
    """
    columns = {control.name: column for column, control in enumerate(controls)}
    default = np.array([control.default for control in controls])
    lower = np.array([control.lower for control in controls])
    upper = np.array([control.upper for control in controls])
    families = family_columns(columns)
    director = np.random.default_rng([acting.seed])
    hands = deal(list(families), acting.clips, min(acting.hand, len(families)), director)
    fewer = {"dialogue": acting.dialogues - 3, "take": 3 - acting.dialogues}
    shots = [kind for kind, style in KINDS.items() for _ in range(style["share"] + fewer.get(kind, 0))]
    casts = deal(list(EXPRESSIONS), acting.clips, 4, director)
    clips = []
    for index in range(acting.clips):
        kind = shots[(index * 7) % len(shots)]  # 7 and 10 share no factor: every ten shots hold all kinds
        generator = np.random.default_rng([acting.seed, index])
        nudges = {name: families[name] for name in hands[index]}
        values = _shot(kind, casts[index], nudges, columns, acting, generator) + default
        values = np.clip(np.round(values, DECIMALS), lower, upper).astype(np.float32)
        clips.append((f"{index:02d}_{kind}_{casts[index][0]}", values))
    return clips


def act_in_arkit_names(controls: Sequence[Control], acting: Acting) -> list[tuple[str, np.ndarray]]:
    """Return clips (name, (t, m) float32) for controls that have ARKit's names or ICT-FaceKit's.

    Those of our controls that have a counterpart among them act as on our own faces (`act`).
    """
    names = {name for name, *_ in name_pairs()}
    ours = [control for group in control_groups().values() for control in group if control.name in names]
    our_names, their_names = [control.name for control in ours], [control.name for control in controls]
    return [
        (name, np.round(in_their_words(our_names, their_names, values), DECIMALS).astype(np.float32))
        for name, values in act(ours, acting)
    ]


def _shot(kind, cast, nudges, columns, acting, generator) -> Float64[np.ndarray, "t m"]:
    """Return one shot's offsets from the default pose: keys, then speech, gaze and blinks over them, then holds."""
    style = KINDS[kind]
    target_frames = int(FRAMES_PER_SECOND * acting.clip_s * generator.uniform(0.6, 1.4))
    rest = np.zeros(len(columns))
    keys, moods, now = [(0.0, rest)], [], generator.uniform(2, 8)
    holds = {0: int(generator.integers(4, 14))} if generator.random() < 0.5 else {}
    lag = _lags(columns)
    while now + sum(holds.values()) < target_frames - 20:
        before = keys[-1][1]
        if kind == "exercise":
            goal = _exercise(columns, generator)
        else:
            goal = _feel(cast[generator.integers(len(cast))], style["gain"], columns, acting, generator)
        for family, members in nudges.items():
            goal = goal + gesture(members, len(columns), acting.polish * QUIET.get(family, 1.0), generator)
        if kind == "take":  # go down to come up
            crouch = pose(columns, {"squash": 0.3, "blink_*": 0.8, "brow_down_*": 0.4, "bend_forward": 0.12})
            keys += move_keys(now, 4.0, before, 0.4 * before + crouch, 0.0, 0.0)
            before, now = keys[-1][1], now + 5
        move = generator.uniform(*style["move"]) / acting.tempo
        overshoot = acting.overshoot * (1.6 if kind == "take" else 1.0)
        keys += move_keys(now, move, before, goal, acting.anticipation, overshoot)
        now += move
        if generator.random() < acting.holds:
            holds[int(now) + int(lag.max()) + 1] = int(generator.integers(5, 22))
        stay = generator.uniform(*style["stay"]) / acting.tempo
        moods.append((now, now + stay))
        now += stay
        keys.append((now, goal))
    frames = int(now + 16)
    keys += move_keys(now, 10.0, keys[-1][1], rest, 0.0, 0.0)
    values = through(keys, frames, lag)
    if kind == "dialogue":
        values = _talk(values, moods, columns, acting, generator)
    values += _breathe(frames, columns, generator)
    values = _look_and_blink(values, list(holds), columns, acting, generator)
    return freeze(values, {frame: count for frame, count in holds.items() if frame < frames - 14 or frame == 0})


def _feel(name, gain, columns, acting, generator) -> Float64[np.ndarray, " m"]:
    """Return an expression as it is played once: with some strength, uneven sides, and amounts a little off."""
    amounts = pose(columns, expression(name, columns))
    if generator.random() < 0.3:  # mixed feelings
        other = list(EXPRESSIONS)[generator.integers(len(EXPRESSIONS))]
        amounts = 0.7 * amounts + 0.4 * pose(columns, expression(other, columns))
    strength = acting.intensity * gain * generator.uniform(0.6, 1.15)
    lean = acting.asymmetry * generator.normal()
    side = np.array([("left" in name) * 1.0 - ("right" in name) for name in columns])
    flip = generator.random() < 0.5  # a smirk to the other side
    if flip:
        amounts = _mirror(amounts, columns)
    return amounts * strength * (1 + np.clip(lean, -0.6, 0.6) * side) * generator.uniform(0.75, 1.2, len(columns))


def _mirror(amounts, columns) -> Float64[np.ndarray, " m"]:
    """Return a pose with left and right exchanged and sideways controls reversed."""
    result = np.empty_like(amounts)
    for name, column in columns.items():
        opposite = name.replace("left", "#").replace("right", "left").replace("#", "right")
        sideways = "sideways" in name or "twist" in name or name.startswith("look_x")
        result[column] = amounts[columns.get(opposite, column)] * (-1 if sideways else 1)
    return result


def _exercise(columns, generator) -> Float64[np.ndarray, " m"]:
    """Return a few controls far out, as in the exercises that test a rig before it is used."""
    goal = np.zeros(len(columns))
    for stem in generator.choice(sorted({_stem(name) for name in columns}), size=min(7, len(columns)), replace=False):
        amount = generator.uniform(0.5, 1.0) * generator.choice([-1, 1, 1])
        for name, column in columns.items():
            if _stem(name) == stem and generator.random() < 0.8:
                goal[column] = amount
    return goal


def _stem(name: str) -> str:
    return name.replace("left", "*").replace("right", "*")


def _lags(columns):
    """Return by how many frames each control drags behind: eyes and brows lead, the mouth follows, ears are last."""
    return np.array([next((lag for start, lag in LAGS.items() if name.startswith(start)), 1) for name in columns])


def _talk(values, moods, columns, acting, generator) -> Float64[np.ndarray, "t m"]:
    """Add speech while a mood lasts: a mouth that talks shows less of the mood, and accents lift the brows."""
    frames = len(values)
    curtain = _curtain(frames)
    mouth = np.array([name.startswith(MOUTH) for name in columns])
    for start, end in moods:
        syllables = max(2, int((end - start) / 7 * acting.tempo))
        entries = speech.schedule(speech.invent(syllables, generator), acting.tempo, generator)
        entries = [entry for entry in entries if entry[1] < end - start]
        mouth_poses, busy = speech.speak(entries, int(start) - 3, frames, columns)
        mouth_poses, busy = mouth_poses * curtain[:, None], busy * curtain
        values = np.where(mouth, values * (1 - 0.6 * busy[:, None]), values) + acting.intensity * mouth_poses
        accents = curtain * blink_profile(frames, list(generator.uniform(start, end, size=2)), 2.0)
        nod = pose(columns, {"brow_inner_up_*": 0.3, "brow_outer_up_*": 0.35, "bend_forward": 0.08, "squash": -0.03})
        values = values + accents[:, None] * nod * generator.uniform(0.4, 1.2)
    return values


def _breathe(frames, columns, generator) -> Float64[np.ndarray, "t m"]:
    """Return the small motion of a living face; holds freeze it too."""
    active = np.flatnonzero(pose(columns, dict.fromkeys(BREATHING, 1.0)))
    values = np.zeros((frames, len(columns)))
    if len(active):
        values[:, active] = 0.012 * drift(frames, len(active), 30.0, generator) * _curtain(frames)[:, None]
    return values


def _curtain(frames) -> Float64[np.ndarray, " t"]:
    """Return factors that are 0 in the first and last frames, 1 between: with them clips begin and end at rest."""
    time = np.arange(frames)
    return np.clip(np.minimum(time - 3, frames - 4 - time) / 10, 0, 1)


def _look_and_blink(values, holds, columns, acting, generator) -> Float64[np.ndarray, "t m"]:
    """Add gaze and blinks with the lids and brows that follow them; no hold stops a blink half-way."""
    frames = len(values)
    darts, keys, time = [], [(0.0, np.zeros(2))], generator.uniform(8, 40)
    while time < frames - 16:
        target = generator.normal(size=2) * (0.45, 0.3) if generator.random() < 0.75 else np.zeros(2)
        keys += [(time, keys[-1][1]), (time + 2.5, target)]
        darts.append(time)
        time += generator.uniform(10, 70)
    keys += [(frames - 14.0, keys[-1][1]), (frames - 11.0, np.zeros(2))]
    gaze = through(keys, frames, np.zeros(2, dtype=int))
    up, down = np.maximum(gaze[:, 1:], 0), np.maximum(-gaze[:, 1:], 0)
    values = values + gaze[:, :1] * pose(columns, {"look_x_*": 1.0}) + gaze[:, 1:] * pose(columns, {"look_y_*": 1.0})
    values += up * pose(columns, {"eye_wide_*": 0.3, "brow_outer_up_*": 0.25, "brow_inner_up_*": 0.2})
    values += down * pose(columns, {"blink_*": 0.3, "brow_down_*": 0.1})

    mean_count = acting.blinks_per_minute * frames / (60 * FRAMES_PER_SECOND)
    starts = list(generator.uniform(4, max(5, frames - 12), size=generator.poisson(mean_count)))
    starts += [dart for dart in darts if generator.random() < 0.2]  # eyes that travel like to blink
    starts = [start for start in starts if not any(start - 2 < hold < start + 12 for hold in holds)]
    closure = blink_profile(frames, starts, generator.uniform(1.0, 1.4))[:, None]
    late = blink_profile(frames, [start + generator.uniform(-0.7, 0.7) for start in starts], 1.1)[:, None]
    left, right = pose(columns, {"blink_left": 1.0}), pose(columns, {"blink_right": 1.0})
    lids = closure * left + late * right
    values = values * (1 - closure * pose(columns, {"eye_wide_*": 0.9})) + lids * (1 - np.clip(values, 0, 1))
    return values + closure * pose(columns, {"brow_down_*": 0.07, "squint_*": 0.12, "cheek_raise_*": 0.05})


# An animator's finishing touches: tweak handles, lip points, lid arcs and wrinkles nudged on key poses.

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
# Factors for families with large effects: a full bend moves the crown by 50 mm, a full lip point a lip by 4 mm.
QUIET = {"head attitude": 0.3, "head shape": 0.5}
ACTIVE_SHARE = 0.75  # share of a family's controls that a gesture moves


def family_columns(columns: Mapping[str, int]) -> dict[str, dict[str, int]]:
    """Return each family's controls, name → column, without families of which the rig has none."""
    families = {
        family: {name: column for name, column in columns.items() if name.startswith(starts)}
        for family, starts in FAMILIES.items()
    }
    return {family: members for family, members in families.items() if members}


def deal(families: Sequence[str], shots: int, hand: int, generator: np.random.Generator) -> list[list[str]]:
    """Return `hand` families for each shot, dealt from shuffled decks so that all are used equally often."""
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

    members: name → column.
    amount: the typical size of the common direction.
    Sideways axes are mirrored between the sides, so an even gesture widens or narrows the face and doesn't shift it.
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
    """Tell whether a control is on a side; lip points are counted 01 … 05 from the character's right to its left."""
    points = {"left": ("_04_", "_05_"), "right": ("_01_", "_02_")}[side]
    return side in name.split("_") or (name.startswith("lip_") and any(point in name for point in points))
