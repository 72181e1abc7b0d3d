"""Invented speech: words, mouth shapes, and how they run into each other."""

import numpy as np
import pytest

from data_recipes.acting import speech
from data_recipes.acting.speech import VISEMES

NAMES = sorted({name.replace("*", side) for shape in VISEMES.values() for name in shape for side in ("left", "right")})
COLUMNS = {name: column for column, name in enumerate(NAMES)}


def test_graphemes_are_read_longest_first():
    assert speech.visemes("sham") == ["sh", "ah", "mbp"]
    assert speech.visemes("toos") == ["tdnl", "oo", "sz"]
    assert speech.visemes("bai") == ["mbp", "ah", "ee"]


@pytest.mark.parametrize("seed", range(5))
def test_every_invented_word_can_be_said(seed):
    words = speech.invent(40, np.random.default_rng(seed))
    shapes = [shape for word in words for shape in speech.visemes(word)]
    assert set(shapes) <= set(VISEMES)
    assert sum(shape in speech.VOWELS for shape in shapes) >= 40


def test_all_visemes_but_rest_can_be_spelled():
    visemes = {shape for shapes in speech.GRAPHEMES.values() for shape in shapes.split()}
    assert visemes == set(VISEMES) - {"rest"}


def test_tempo_shortens_a_schedule():
    words = speech.invent(20, np.random.default_rng(0))
    slow, quick = (speech.schedule(words, tempo, np.random.default_rng(1))[-1][1] for tempo in (0.8, 1.6))
    assert quick < 0.75 * slow


def test_lips_close_for_a_b_between_open_vowels():
    entries = [("ah", 3.0, 3.0, 1.0), ("mbp", 7.0, 1.6, 1.0), ("ah", 11.0, 3.0, 1.0)]
    values, busy = speech.speak(entries, 0, 30, COLUMNS)
    jaw, together = values[:, COLUMNS["jaw_open"]], values[:, COLUMNS["lips_together"]]
    assert jaw[7] < 0.6 * jaw[3] and together[7] > 0.5 and together[3] < 0.3
    assert busy[7] > 0.9 and busy[29] < 0.05
    assert not values[29].any()


def test_a_k_yields_to_its_vowels_more_than_an_f_does():
    def jaw_at_consonant(shape):
        entries = [("ah", 3.0, 3.0, 1.0), (shape, 7.0, 1.6, 1.0), ("ah", 11.0, 3.0, 1.0)]
        values = speech.speak(entries, 0, 20, COLUMNS)[0]
        own = VISEMES[shape]["jaw_open"]
        return (values[7, COLUMNS["jaw_open"]] - own) / (VISEMES["ah"]["jaw_open"] - own)

    assert jaw_at_consonant("kg") > 2 * jaw_at_consonant("fv")
