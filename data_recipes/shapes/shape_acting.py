"""Acting for a face that comes without animation: invented clips in which few controls move at a time.

Where enough names are ARKit's (or VRM's, see `arkit_names`), our own acting plays on them, and what it doesn't reach
gets clips of its own. Elsewhere all clips are of that kind: left and right mostly move together, and of opposites, such
as up and down, one at a time. So a face's own limits are all that is known of it, and its poses are still a face's.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from data_recipes.acting.arkit_names import canonical, name_pairs
from data_recipes.acting.motion import FRAMES_PER_SECOND, freeze, move_keys, through
from data_recipes.acting.procedural_acting import DECIMALS, Acting, act_in_arkit_names
from data_recipes.controls import Control
from data_recipes.shapes.control_names import mirrored_pairs, opposite

ENOUGH = 12  # controls with names that our acting knows
SHARE = 4  # one clip in so many is for the controls that our acting doesn't reach
GESTURES = (0.35, 0.3, 0.2, 0.1, 0.05)  # how often a pose has one, two, … of them
TOGETHER = 0.7  # how often both sides of a pair move alike
MOVE, STAY = (5, 14), (1, 12)  # frames
UNREACHED = 0.1  # of a control's range: our acting has to move it so far, or it gets clips of its own


def act_shapes(controls: Sequence[Control], acting: Acting) -> list[tuple[str, np.ndarray]]:
    """Return clips (name, (t, m) float32) for these controls, within their limits.

    The same arguments give the same clips, to the last bit.
    """
    known = {theirs for _, _, theirs, _ in name_pairs()}
    known |= {name[:-2] for name in known if name[-2:] in ("_L", "_R")}
    named = [canonical(control.name) in known for control in controls]
    lower, default, upper = (
        np.array([getattr(control, name) for control in controls]) for name in ("lower", "default", "upper")
    )
    clips, left = [], np.arange(len(controls))
    if sum(named) >= ENOUGH:
        span = np.where(named, np.maximum(upper, 1e-9), 0.0)
        clips = [(name, np.clip(values * span, lower, upper)) for name, values in act_in_arkit_names(controls, acting)]
        reached = np.max([values.max(0) - values.min(0) for _, values in clips], axis=0) if clips else 0 * lower
        left = np.flatnonzero(reached < UNREACHED * (upper - lower))
        clips = clips[: len(clips) - len(clips) // SHARE] if len(left) else clips
    for index in range(len(clips), acting.clips if len(left) else 0):
        generator = np.random.default_rng([acting.seed, index])
        values = _clip([controls[k] for k in left], acting, generator)
        whole = np.tile(default, (len(values), 1))
        whole[:, left] = values
        clips.append((f"{index:02d}_gestures", np.clip(whole, lower, upper)))
    return [(name, np.round(values, DECIMALS).astype(np.float32)) for name, values in clips]


def _clip(controls: Sequence[Control], acting: Acting, generator: np.random.Generator) -> Float64[np.ndarray, "t m"]:
    """Return one clip: from rest to pose after pose and back, with holds."""
    rest = np.array([control.default for control in controls])
    pairs = mirrored_pairs([control.name for control in controls])
    length = FRAMES_PER_SECOND * acting.clip_s * generator.uniform(0.6, 1.4)
    keys, now, holds = [(0.0, rest)], 4.0, {}
    while now < length - 20:
        goal = sparse_pose(controls, pairs, acting.intensity, generator)
        move = generator.uniform(*MOVE) / acting.tempo
        keys += move_keys(now, move, keys[-1][1], goal, 0.0, 0.0)
        now += move
        if generator.random() < acting.holds:
            holds[int(now)] = int(generator.integers(4, 16))
        now += generator.uniform(*STAY) / acting.tempo
        keys.append((now, goal))
    keys += move_keys(now, 10.0, keys[-1][1], rest, 0.0, 0.0)
    return freeze(through(keys, int(now + 14), np.zeros(len(controls), int)), holds)


def sparse_pose(
    controls: Sequence[Control], pairs: Sequence[tuple[int, ...]], intensity: float, generator: np.random.Generator
) -> Float64[np.ndarray, " m"]:
    """Return a pose of few gestures, each a control or a pair of them, between their defaults and their limits.

    pairs: as `mirrored_pairs` gives them.
    """
    values = np.array([control.default for control in controls])
    count = 1 + int(generator.choice(len(GESTURES), p=GESTURES))
    chosen: list[int] = []
    for group in generator.permutation(len(pairs)):
        members = list(pairs[group])
        if len(members) > 1 and generator.random() > TOGETHER:
            members = [members[int(generator.integers(len(members)))]]
        if any(opposite(canonical(controls[a].name), canonical(controls[b].name)) for a in members for b in chosen):
            continue
        amount = min(1.0, intensity * generator.beta(2.0, 1.3))
        up = generator.random() < 0.5
        for k in members:
            c = controls[k]
            goes_up = c.upper > c.default and (up or c.lower >= c.default)
            limit = c.upper if goes_up else c.lower
            values[k] = c.default + amount * generator.uniform(0.85, 1.0) * (limit - c.default)
        chosen += members
        count -= 1
        if not count:
            break
    return values
