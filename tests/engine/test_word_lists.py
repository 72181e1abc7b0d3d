"""Lists as people type them: commas, spaces, and quotes around paths with spaces."""

import pytest

from replicate.engine.exceptions import InputError
from replicate.engine.word_lists import words


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("teen,dragon woman", ["teen", "dragon", "woman"]),
        (["teen, dragon", "woman"], ["teen", "dragon", "woman"]),
        (" , ,", []),
        ("", []),
        ("'my face.toml' teen", ["my face.toml", "teen"]),
        ('teen,"a, b/my face.toml"', ["teen", "a, b/my face.toml"]),
        (['"my face.toml"', "#3.toml"], ["my face.toml", "#3.toml"]),
        ("a\n\tb", ["a", "b"]),
    ],
)
def test_words_stand_between_commas_or_spaces(text, expected):
    assert words(text) == expected


@pytest.mark.parametrize("text", ['"my face.toml teen', "it's", ["'a", "b"]])
def test_a_quote_that_does_not_end_is_named(text):
    with pytest.raises(InputError, match="a quote does not end"):
        words(text)
