"""What the names of somebody else's controls say: a side, a counterpart, a region of the face, ARKit's name."""

from __future__ import annotations

import re
from collections.abc import Sequence

from data_recipes.acting.arkit_names import canonical

_SIDE = re.compile(r"(?i:(?<![a-z])(left|right|l|r)(?![a-z]))|(Left|Right)|(?<=[a-z])([LR])$")
_OPPOSITES = (
    ("up", "down"),
    ("in", "out"),
    ("left", "right"),
    ("open", "close"),
    ("wide", "blink"),
    ("wide", "squint"),
    ("smile", "frown"),
    ("upper", "lower"),
    ("raise", "lower"),
    ("pucker", "stretch"),
    ("puff", "suck"),
)
_REGIONS = (  # the first word that a name has decides; "*" becomes the side
    ("brow|forehead", "brows"),
    ("eye|lid|blink|squint|wink|gaze|look", "eye_*"),
    ("nose|nostril|sneer", "nose"),
    ("jaw|chin", "jaw"),
    ("mouth|lip|smile|frown|pucker|funnel|viseme|tongue|dimple|teeth|mth|phoneme|vrc", "mouth"),
    ("cheek|puff", "cheeks"),
    ("ear", "ears"),
    ("neck|throat", "neck"),
)
WITHOUT_REGION = "face"
_MIDDLE = ("jaw", "mouth", "tongue", "head", "neck", "chin", "nose")  # of which left is a direction and no side


def side_of(name: str) -> tuple[str, str]:
    """Return a name with * for its side, and "left", "right" or "" for one without a side."""
    found = list(_SIDE.finditer(name))
    if not found:
        return name, ""
    last = found[-1]
    word = next(group for group in last.groups() if group)
    if re.sub("[^a-z]", "", name[: last.start()].lower()) in _MIDDLE and not name[last.end() :]:
        return name, ""
    return f"{name[: last.start()]}*{name[last.end() :]}", "left" if word[0] in "lL" else "right"


def mirrored_pairs(names: Sequence[str]) -> list[tuple[int, ...]]:
    """Return the controls by their places, left and right of a pair together, in the order of their first."""
    groups: dict[str, list[int]] = {}
    for place, name in enumerate(names):
        stem, side = side_of(canonical(name))
        groups.setdefault(stem if side else name, []).append(place)
    return [tuple(group) for group in groups.values()]


def opposite(first: str, second: str) -> bool:
    """Return whether two names differ by one word and its opposite, such as jawLeft and jawRight, or up and down."""
    a, b = ([word.lower() for word in _words(name)] for name in (first, second))
    if len(a) != len(b):
        return False
    different = [pair for pair in zip(a, b, strict=True) if pair[0] != pair[1]]
    return len(different) == 1 and any(set(different[0]) == set(pair) for pair in _OPPOSITES)


def _words(name: str) -> list[str]:
    return re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+", name)


def region_of_control(name: str) -> str:
    """Return the region of the face that a control's name speaks of, "face" if it says nothing."""
    side = side_of(canonical(name))[1]
    for words, region in _REGIONS:
        if re.search(words, name, re.IGNORECASE):
            return region.replace("eye_*", f"eye_{side}" if side else "eyes")
    return WITHOUT_REGION
