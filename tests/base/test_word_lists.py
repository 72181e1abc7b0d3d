"""Lists as people type them: commas, spaces, and quotes around paths with spaces."""

import pytest

from replicate.base.exceptions import InputError
from replicate.base.user_files import words


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


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a b/face", ["a b/face"]),
        (["a b/face"], ["a b/face"]),
        (" a b/face ", ["a b/face"]),
        ('teen,a b/face, "it\'s, one.py"', ["teen", "a b/face", "it's, one.py"]),
        (["teen", "a b/face", "woman"], ["teen", "a b/face", "woman"]),
        ("~/a b/face", ["~/a b/face"]),
        ("a b/none", ["a", "b/none"]),
    ],
)
def test_what_names_a_file_or_folder_that_is_there_is_one_word(tmp_path, monkeypatch, text, expected):
    (tmp_path / "a b" / "face").mkdir(parents=True)
    (tmp_path / "it's, one.py").write_text("")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert words(text) == expected
    assert words("it's, one.py") == ["it's, one.py"]
