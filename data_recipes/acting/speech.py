"""Speech without words: invented syllables, a grapheme → viseme schedule, and coarticulation.

Coarticulation follows the idea of dominance functions (Cohen and Massaro 1993): every mouth shape has a weight
that rises and falls around its centre, and the mouth takes the weighted mean. Shapes in which lips must touch (m, b,
p, f, v) outweigh their neighbours; a k yields to the vowels around it.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float64

from data_recipes.acting.motion import pose

ONSETS = (*"bmpfvtdnlszkgrw", "sh", "ch", "th", "pl", "br", "st", "")
NUCLEI = (*"aeiou", "oo", "ee", "ai", "ou")
CODAS = (*"nmsltkrp", "sh", "", "", "")
# Letters, longest first → one viseme, or the two of a diphthong.
GRAPHEMES = {
    "sh": "sh", "ch": "sh", "th": "th", "oo": "oo", "ee": "ee", "ai": "ah ee", "ou": "ah oo", "a": "ah", "e": "eh",
    "i": "ee", "o": "oh", "u": "oo", "b": "mbp", "m": "mbp", "p": "mbp", "f": "fv", "v": "fv", "t": "tdnl", "d": "tdnl",
    "n": "tdnl", "l": "tdnl", "s": "sz", "z": "sz", "k": "kg", "g": "kg", "r": "r", "w": "oo",
}  # fmt: skip
VOWELS = frozenset({"ah", "eh", "ee", "oh", "oo"})
DOMINANCE = {"mbp": 4.0, "fv": 3.0, "th": 1.5, "sh": 1.5, "oo": 1.5, "kg": 0.5, "tdnl": 0.7}
PAUSE_FRAMES = 6.0


def invent(syllables: int, generator: np.random.Generator) -> list[str]:
    """Return words of one to three invented syllables, so many syllables in all."""
    words, left = [], syllables
    while left > 0:
        count = min(left, int(generator.integers(1, 4)))
        parts = [str(generator.choice(letters)) for _ in range(count) for letters in (ONSETS, NUCLEI, CODAS)]
        words.append("".join(parts))
        left -= count
    return words


def visemes(word: str) -> list[str]:
    """Return the mouth shapes of an invented word, by its longest graphemes. Raises KeyError for other letters."""
    shapes, at = [], 0
    while at < len(word):
        grapheme = word[at : at + 2] if word[at : at + 2] in GRAPHEMES else word[at]
        shapes += GRAPHEMES[grapheme].split()
        at += len(grapheme)
    return shapes


def schedule(words: list[str], tempo: float, generator: np.random.Generator) -> list[tuple[str, float, float, float]]:
    """Return (viseme, centre, width, loudness) of each mouth shape, times in frames from the start of the speech.

    Vowels take 4 to 6 frames and consonants 2 to 3, over `tempo`. One syllable in four is stressed: longer and wider.
    """
    entries, time = [], 0.0
    for word in words:
        for shape in visemes(word):
            vowel = shape in VOWELS
            stress = 1.25 if vowel and generator.random() < 0.25 else 1.0
            length = (generator.uniform(4, 6) if vowel else generator.uniform(2, 3)) * stress / tempo
            entries.append((shape, time + length / 2, 0.45 * length, stress * generator.uniform(0.75, 1.1)))
            time += length
        if generator.random() < 0.35:
            entries.append(("rest", time + PAUSE_FRAMES / 2, 0.4 * PAUSE_FRAMES, 1.0))
            time += PAUSE_FRAMES
    return entries


def speak(
    entries: list[tuple[str, float, float, float]], start: int, frames: int, columns: Mapping[str, int]
) -> tuple[Float64[np.ndarray, "frames m"], Float64[np.ndarray, " frames"]]:
    """Return the mouth's poses while it speaks a schedule from frame `start` on, and how busy it is (0 … 1)."""
    time = np.arange(frames) - start
    weighted, total = np.zeros((frames, len(columns))), np.full(frames, 0.05)  # the weight of the pose at rest
    for shape, centre, width, loudness in entries:
        dominance = DOMINANCE.get(shape, 1.0) * np.exp(-0.5 * ((time - centre) / width) ** 2)
        # A lip closure is no louder in loud speech: lips touch or they don't.
        amount = 1.0 if DOMINANCE.get(shape, 1.0) >= 3 else loudness
        weighted += dominance[:, None] * amount * pose(columns, VISEMES[shape])
        total += dominance
    values = weighted / total[:, None]
    values[np.abs(values) < 1e-3] = 0  # Gaussians never end; speech does
    return values, 1 - 0.05 / total


# Mouth shapes of speech: amounts of the named controls. Their weights are in DOMINANCE.

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
